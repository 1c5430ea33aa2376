"""Frames that are read from bags, against the poses that these were written with."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from marssim.base.bags.messages import frames_message, odometry_message, twist_message
from marssim.base.bags.reader import Bag
from marssim.base.bags.transform_reader import frame_topics, read_transforms
from marssim.base.bags.writer import BagWriter


def pose(x, yaw=0.0):
    out = np.eye(4)
    out[:3, :3] = Rotation.from_euler("z", yaw).as_matrix()
    out[0, 3] = x
    return out


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


def test_odometry_of_a_frame_that_is_fixed_in_another_one_moves_that_one(drive, tmp_path):
    """As where a description of the rover has base_footprint -> base_link, and the odometry is of base_link."""
    foot, believed = pose(0.25, 0.5), [pose(7, 1.0), pose(9, 2.0)]
    with BagWriter(tmp_path / "bag") as bag:
        bag.write("/tf_static", 5, frames_message(5, [("base_footprint", "base_link", foot)]))
        for stamp, body in zip(drive.stamps, believed):
            bag.write("/odom", stamp, odometry_message(stamp, "odom", "/base_link", body))
            bag.write("/second", stamp, odometry_message(stamp, "vo", "base_link", pose(500)))
    tree = read_transforms(Bag(tmp_path / "bag"))
    assert tree.odometry == {"base_footprint"} and tree.world("base_link") == "odom"
    for stamp, body in zip(drive.stamps, believed):
        np.testing.assert_allclose(tree.pose("base_link", stamp), body, atol=1e-12)
        np.testing.assert_allclose(tree.pose("base_footprint", stamp), body @ np.linalg.inv(foot), atol=1e-12)


@pytest.mark.parametrize("child", ["odom", "map"])
def test_odometry_of_a_frame_around_its_own_makes_no_circle(tmp_path, child):
    with BagWriter(tmp_path / "bag") as bag:
        bag.write("/tf_static", 5, frames_message(5, [("map", "odom", pose(1))]))
        bag.write("/odom", 5, odometry_message(5, "odom", child, pose(7)))
    tree = read_transforms(Bag(tmp_path / "bag"))
    assert not tree.odometry and tree.pose("odom", 5) == pytest.approx(pose(1))


@pytest.mark.parametrize(
    ("topics", "near", "expected"),
    [
        (["/tf", "/a/tf", "/a/tf_static"], "/a/left/image", ("/tf", "/a/tf_static")),
        (["/a/tf", "/b/tf", "/b/tf_static"], "/b/left/image", ("/b/tf", "/b/tf_static")),
        (["/b/tf", "/a/tf"], "/a/tf", ("/a/tf", "/tf_static")),
        (["/fleet/b/tf", "/a/tf"], "/fleet/b/eye/image", ("/fleet/b/tf", "/tf_static")),
        (["/my_tf"], "/left/image", ("/tf", "/tf_static")),
    ],
)
def test_frames_of_a_namespace_are_found_by_the_topic_of_the_images(tmp_path, topics, near, expected):
    with BagWriter(tmp_path / "bag") as bag:
        for topic in topics:
            bag.write(topic, 5, frames_message(5, [("base_link", f"eye_of{topic}", pose(1))]))
    assert frame_topics(Bag(tmp_path / "bag"), near) == expected
    tree = read_transforms(Bag(tmp_path / "bag"), near)
    assert {topic for topic in topics if tree.parent(f"eye_of{topic}")} == set(topics) & set(expected)


def test_odometry_without_a_pose_is_none(tmp_path):
    message = odometry_message(5, "odom", "base_link", pose(7))
    message.pose.pose.orientation.w = 0.0  # as some nodes send it before they know better
    with BagWriter(tmp_path / "bag") as bag:
        bag.write("/odom", 5, message)
    tree = read_transforms(Bag(tmp_path / "bag"))
    assert not tree.odometry and tree.parent("base_link") is None
