"""Frames of frames at a time, against poses multiplied by hand."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from marssim.base.bags.messages import odometry_message, twist_message
from marssim.base.bags.reader import Bag
from marssim.base.bags.transforms import Transforms, read_transforms
from marssim.base.bags.writer import BagWriter


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
    assert tree.world("eye") is None and tree.world("nothing") is None and not tree.has_parent("base_link")
    tree.add("eye", "base_link", pose(1), 5)
    assert tree.world("eye") is None and tree.pose("eye", 5) is None and not tree.contains("map", "eye")


@pytest.mark.parametrize("outermost", ["base_link", "/base_footprint", "rover/base_link", "body"])
def test_a_mast_that_turns_on_a_rover_moves_in_no_world(outermost):
    tree = Transforms()
    tree.add("mast", "eye", pose(1))
    tree.add(outermost, "mast", pose(1), 5)
    assert tree.world("eye") is None
    tree.add("odom", outermost, pose(1), 5)
    assert tree.world("eye") == "odom"


def test_a_bag_gives_the_true_pose_of_its_cameras(drive):
    tree = read_transforms(Bag(drive.path))
    assert tree.world("left_camera_optical") == "map"
    for stamp, camera in zip(drive.stamps, drive.camera, strict=True):
        np.testing.assert_allclose(tree.pose("left_camera_optical", stamp), camera, atol=1e-9)
        right = tree.pose("right_camera_optical", stamp)
        np.testing.assert_allclose(right, drive.rig.right_pose(camera), atol=1e-9)


@pytest.mark.parametrize("frames", [True, False])
def test_odometry_counts_where_tf_says_nothing_of_its_child(drive, tmp_path, frames):
    with BagWriter(tmp_path / "bag") as bag:
        for _, message in Bag(drive.path).messages(["/tf"] if frames else []):
            bag.write("/tf", drive.stamps[0], message)
        bag.write("/wheels", 5, odometry_message(drive.stamps[0], "odom", "base_link", pose(7)))
        bag.write("/cmd_vel", 5, twist_message(0, 0))
    tree = read_transforms(Bag(tmp_path / "bag"))
    assert tree.world("base_link") == ("map" if frames else "odom")
    expected = drive.body[0] if frames else pose(7)
    np.testing.assert_allclose(tree.pose("base_link", drive.stamps[0]), expected, atol=1e-9)


def test_transforms_without_a_rotation_are_left_out(drive, tmp_path):
    (_, message), *_ = Bag(drive.path).messages(["/tf"])
    for item in message.transforms:
        item.transform.rotation.x = item.transform.rotation.y = item.transform.rotation.z = 0.0
        item.transform.rotation.w = 0.0 if item.child_frame_id == "odom" else float("nan")
    with BagWriter(tmp_path / "bag") as bag:
        bag.write("/tf", 5, message)
    assert read_transforms(Bag(tmp_path / "bag")).pose("left_camera", drive.stamps[0]) == pytest.approx(np.eye(4))
