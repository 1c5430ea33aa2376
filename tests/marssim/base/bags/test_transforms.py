"""Frames of frames at a time, against poses multiplied by hand."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from marssim.base.bags.transforms import Transforms


def pose(x, yaw=0.0):
    out = np.eye(4)
    out[:3, :3] = Rotation.from_euler("z", yaw).as_matrix()
    out[0, 3] = x
    return out


def test_a_pose_is_interpolated_between_two_times_and_unknown_beyond_them():
    tree = Transforms()
    tree.add("map", "/odom", pose(0, 0.5))
    tree.add("odom", "base_link", pose(1, 0.0), 100)
    tree.add("odom", "base_link", pose(3, 1.0), 300)
    tree.add("base_link", "eye", pose(0.5))
    assert tree.world("eye") == "map" and tree.contains("base_link", "eye") and not tree.contains("eye", "base_link")
    for stamp, x, yaw in ((100, 1, 0), (150, 1.5, 0.25), (300, 3, 1)):
        np.testing.assert_allclose(tree.pose("eye", stamp), pose(0, 0.5) @ pose(x, yaw) @ pose(0.5), atol=1e-12)
    assert tree.pose("eye", 99) is None and tree.pose("eye", 301) is None


def test_a_pose_in_another_frame_needs_only_the_frames_between_them():
    tree = Transforms()
    tree.add("odom", "base_link", pose(1), 100)
    tree.add("/base_link", "mast", pose(0.5, 0.5))
    tree.add("mast", "eye", pose(0.2), 100)
    np.testing.assert_allclose(tree.pose("mast", 99, "/base_link"), pose(0.5, 0.5))
    np.testing.assert_allclose(tree.pose("/eye", 100, "base_link"), pose(0.5, 0.5) @ pose(0.2))
    assert tree.pose("eye", 99, "base_link") is None and tree.pose("eye", 100, "wheel") is None


def test_what_stands_still_has_no_world_and_a_circle_has_no_pose():
    tree = Transforms()
    tree.add("base_link", "eye", pose(1))
    assert tree.world("eye") is None and tree.world("nothing") is None and tree.parent("base_link") is None
    tree.add("eye", "base_link", pose(1), 5)
    assert tree.world("eye") is None and tree.pose("eye", 5) is None and not tree.contains("map", "eye")


@pytest.mark.parametrize("outermost", ["base_link", "/base_footprint", "rover/base_link", "body"])
def test_a_mast_that_turns_on_a_rover_moves_in_no_world(outermost):
    tree = Transforms()
    tree.add("mast", "eye", pose(1))
    tree.add("foot", "mast", pose(1), 5)
    tree.add(outermost, "foot", pose(1))
    assert tree.world("eye") is None
    tree.add("odom", outermost, pose(1), 5)
    assert tree.world("eye") == "odom"


@pytest.mark.parametrize(
    ("frames", "expected"),
    [
        (["map", "odom", "base_link", "eye"], "base_link"),
        (["map", "rover1/base_link", "arm/base_link", "eye"], "rover1/base_link"),
        (["odom", "/rover/base_footprint", "base_link", "eye"], "rover/base_footprint"),
        (["odom", "ptu_base_link", "eye"], None),
        (["base_link"], None),
    ],
)
def test_the_frame_of_the_rover_is_found_in_a_namespace_and_on_the_ground(frames, expected):
    tree = Transforms()
    for parent, child in pairwise(frames):
        tree.add(parent, child, pose(1))
    assert tree.rover(frames[-1]) == expected


@pytest.mark.parametrize(
    ("frames", "expected"),
    [
        (["earth", "map", "odom", "base_link"], "map"),
        (["utm", "rover1/map", "odom", "base_link"], "rover1/map"),
        (["utm", "odom", "base_link"], "odom"),
        (["utm", "base_link"], "utm"),
        (["world", "odom", "base_link"], "world"),
    ],
)
def test_the_world_is_the_map_and_no_frame_of_the_earth_around_others(frames, expected):
    """REP 105: earth -> map -> odom -> base_link."""
    tree = Transforms()
    for parent, child in pairwise(frames):
        far = parent in ("earth", "utm")
        tree.add(parent, child, pose(4e6 if far else 1), None if far and child != "base_link" else 5)
    assert tree.world("base_link") == expected
    steps = frames.index("base_link") - frames.index(expected)
    assert tree.pose("base_link", 5, expected)[0, 3] == (4e6 if expected == "utm" else steps)


def test_a_frame_in_two_frames_is_kept_in_one_of_them():
    tree = Transforms()
    for stamp in (10, 20):
        tree.add("vo", "base_link", pose(100), stamp)
        tree.add("odom", "base_link", pose(1), stamp + 1)
        tree.add("map", "base_link", pose(50), stamp + 2)
    tree.add("base_link", "eye", pose(0))
    tree.add("other", "eye", pose(9))
    assert tree.world("eye") == "odom" and tree.pose("base_link", 15)[0, 3] == 1
    assert tree.other_parents("eye") == [
        ("eye", "base_link", ["other"]), ("base_link", "odom", ["map", "vo"])
    ]  # fmt: skip
    assert list(tree.moves("base_link")) == [11, 21] and tree.moves("eye") == {} and len(tree) == 2
