"""What the bags hold, as the readers of two other projects see it."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from marssim.base.bags.messages import SECOND

KINDS = {
    "/stereo/left/image_rect": "sensor_msgs/Image", "/stereo/right/image_rect": "sensor_msgs/Image",
    "/stereo/left/camera_info": "sensor_msgs/CameraInfo", "/stereo/right/camera_info": "sensor_msgs/CameraInfo",
    "/stereo/depth/image_rect": "sensor_msgs/Image", "/stereo/depth/camera_info": "sensor_msgs/CameraInfo",
    "/stereo/disparity": "stereo_msgs/DisparityImage", "/stereo/points2": "sensor_msgs/PointCloud2",
    "/ground_truth/pose": "geometry_msgs/PoseStamped", "/odom": "nav_msgs/Odometry", "/cmd_vel": "geometry_msgs/Twist",
    "/navigator/status": "std_msgs/String", "/navigator/path": "nav_msgs/Path",
    "/navigator/goal": "geometry_msgs/PoseStamped", "/tf": "tf2_msgs/TFMessage", "/tf_static": "tf2_msgs/TFMessage",
}  # fmt: skip
FRAMES = {
    "/stereo/left/image_rect": "left_camera_optical", "/stereo/left/camera_info": "left_camera_optical",
    "/stereo/right/image_rect": "right_camera_optical", "/stereo/right/camera_info": "right_camera_optical",
    "/stereo/depth/image_rect": "left_camera_optical", "/stereo/depth/camera_info": "left_camera_optical",
    "/stereo/disparity": "left_camera_optical", "/stereo/points2": "left_camera_optical",
    "/ground_truth/pose": "map", "/odom": "odom", "/navigator/path": "odom", "/navigator/goal": "map",
}  # fmt: skip


def on_topic(messages, topic):
    return [read.message for read in messages if read.topic == topic]


def stamp(message):
    return message.header.stamp.sec * SECOND + message.header.stamp.nanosec


def matrix(transform):
    """The (4, 4) pose of a geometry_msgs/Transform or geometry_msgs/Pose."""
    place, turn = (getattr(transform, a, None) or getattr(transform, b)
                   for a, b in (("translation", "position"), ("rotation", "orientation")))  # fmt: skip
    out = np.eye(4)
    out[:3, :3] = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix()
    out[:3, 3] = place.x, place.y, place.z
    return out


def test_each_topic_has_its_type_stamps_and_frame(drive, read_all):
    messages = read_all(drive.path)
    assert {read.topic: read.kind for read in messages} == KINDS
    for topic in KINDS:
        times = [read.recorded for read in messages if read.topic == topic]
        assert times == (drive.stamps if topic != "/tf_static" else drive.stamps[:1])
    for topic, frame in FRAMES.items():
        assert [stamp(m) for m in on_topic(messages, topic)] == drive.stamps
        assert {m.header.frame_id for m in on_topic(messages, topic)} == {frame}


def test_images_and_depth_are_what_was_written(drive, read_all):
    messages = read_all(drive.path)
    for topic, images in (("/stereo/left/image_rect", drive.left), ("/stereo/right/image_rect", drive.right)):
        for message, image in zip(on_topic(messages, topic), images, strict=True):
            assert (message.height, message.width, message.encoding, message.step) == (12, 16, "rgb8", 48)
            np.testing.assert_array_equal(np.frombuffer(bytes(message.data), np.uint8).reshape(12, 16, 3), image)
    for message, depth in zip(on_topic(messages, "/stereo/depth/image_rect"), drive.depth, strict=True):
        assert (message.encoding, message.step, message.is_bigendian) == ("32FC1", 64, 0)
        np.testing.assert_array_equal(np.frombuffer(bytes(message.data), "<f4").reshape(12, 16), depth)  # REP 118


def test_camera_info_describes_rectified_cameras_with_the_baseline_in_that_of_the_right_eye(drive, read_all):
    messages, k = read_all(drive.path), drive.rig.camera.K
    for side, tx in (("left", 0.0), ("right", -20.0 * 0.27), ("depth", 0.0)):
        for message in on_topic(messages, f"/stereo/{side}/camera_info"):
            names = {name.lower(): getattr(message, name) for name in dir(message) if len(name) == 1}
            np.testing.assert_array_equal(np.reshape(names["k"], (3, 3)), k)
            np.testing.assert_array_equal(np.reshape(names["r"], (3, 3)), np.eye(3))
            np.testing.assert_array_equal(np.reshape(names["p"], (3, 4)), np.column_stack([k, [tx, 0, 0]]))
            assert (list(names["d"]), message.distortion_model) == ([0.0] * 5, "plumb_bob")
            assert (message.width, message.height, message.binning_x, message.roi.width) == (16, 12, 0, 0)


def test_frames_are_those_of_rep_103_and_105(drive, read_all):
    messages = read_all(drive.path)
    (fixed,) = on_topic(messages, "/tf_static")
    fixed = {(t.header.frame_id, t.child_frame_id): matrix(t.transform) for t in fixed.transforms}
    assert set(fixed) == {
        ("left_camera", "left_camera_optical"), ("left_camera", "right_camera"),
        ("right_camera", "right_camera_optical"),
    }  # fmt: skip
    for side in ("left", "right"):  # an optical frame: z forward, x right, y down, in one with x forward and z up
        optical = fixed[f"{side}_camera", f"{side}_camera_optical"]
        np.testing.assert_allclose(optical[:3, :3] @ np.eye(3), [[0, 0, 1], [-1, 0, 0], [0, -1, 0]], atol=1e-12)
    np.testing.assert_allclose(fixed["left_camera", "right_camera"][:3, 3], [0, -0.27, 0], atol=1e-12)
    for number, message in enumerate(on_topic(messages, "/tf")):
        moving = {(t.header.frame_id, t.child_frame_id): matrix(t.transform) for t in message.transforms}
        assert list(moving) == [("map", "odom"), ("odom", "base_link"), ("base_link", "left_camera")]
        assert {stamp(t) for t in message.transforms} == {drive.stamps[number]}
        rover = moving["map", "odom"] @ moving["odom", "base_link"]
        eye = rover @ moving["base_link", "left_camera"] @ fixed["left_camera", "left_camera_optical"]
        np.testing.assert_allclose(moving["odom", "base_link"], drive.believed[number], atol=1e-9)
        np.testing.assert_allclose(rover, drive.body[number], atol=1e-9)
        np.testing.assert_allclose(eye, drive.camera[number], atol=1e-9)
        right = rover @ moving["base_link", "left_camera"] @ fixed["left_camera", "right_camera"]
        np.testing.assert_allclose(right[:3, 3], drive.rig.right_pose(drive.camera[number])[:3, 3], atol=1e-9)
    for message, true in zip(on_topic(messages, "/ground_truth/pose"), drive.body, strict=True):
        np.testing.assert_allclose(matrix(message.pose), true, atol=1e-9)
    for message, believed in zip(on_topic(messages, "/odom"), drive.believed, strict=True):
        assert message.child_frame_id == "base_link"
        np.testing.assert_allclose(matrix(message.pose.pose), believed, atol=1e-9)


def test_points_and_disparity_agree_with_depth_through_the_camera_info(drive, read_all):
    """By P and by Z = f T / d alone, as a consumer of the bag has them."""
    messages = read_all(drive.path)
    p = np.column_stack([drive.rig.camera.K, np.zeros(3)])
    for number, cloud in enumerate(on_topic(messages, "/stereo/points2")):
        assert [(f.name, f.offset, f.datatype, f.count) for f in cloud.fields] == [
            ("x", 0, 7, 1), ("y", 4, 7, 1), ("z", 8, 7, 1), ("rgb", 12, 7, 1)
        ]  # fmt: skip
        assert (cloud.height, cloud.point_step, cloud.row_step) == (1, 16, 16 * cloud.width) and cloud.is_dense
        rows = np.frombuffer(bytes(cloud.data), "<f4").reshape(-1, 4)
        bgr = np.frombuffer(bytes(cloud.data), np.uint8).reshape(-1, 16)[:, 12:15]
        u, v, w = p @ np.column_stack([rows[:, :3], np.ones(len(rows))]).T
        column, row = np.round(u / w).astype(int), np.round(v / w).astype(int)
        assert len(rows) == np.isfinite(drive.depth[number]).sum() == len(set(zip(column, row)))
        np.testing.assert_allclose(rows[:, 2], drive.depth[number][row, column], rtol=1e-6)
        np.testing.assert_array_equal(bgr[:, ::-1], drive.left[number][row, column])
    for number, message in enumerate(on_topic(messages, "/stereo/disparity")):
        disparity = np.frombuffer(bytes(message.image.data), "<f4").reshape(12, 16)
        depth = drive.depth[number]
        assert (message.image.encoding, message.f, message.t) == ("32FC1", 20.0, pytest.approx(0.27))
        assert (disparity[0] == 0).all() and (disparity[1] < message.min_disparity).all()
        seen = np.isfinite(depth)
        np.testing.assert_allclose(message.f * message.t / disparity[seen], depth[seen], rtol=1e-5)
        assert message.max_disparity == disparity.max() > 0


def test_commands_statuses_paths_and_goals_are_what_was_written(drive, read_all):
    messages = read_all(drive.path)
    assert [(m.linear.x, m.angular.z) for m in on_topic(messages, "/cmd_vel")] == [(0.1 * n, -0.05) for n in range(3)]
    assert [m.data for m in on_topic(messages, "/navigator/status")] == ["drive"] * 3
    path = on_topic(messages, "/navigator/path")[0]
    assert [(p.pose.position.x, p.pose.position.y) for p in path.poses] == [(0, 0), (1, 1)]
    for place in path.poses:  # both look along the way
        np.testing.assert_allclose(matrix(place.pose)[:3, 0], [np.sqrt(0.5), np.sqrt(0.5), 0], atol=1e-9)
    assert on_topic(messages, "/navigator/goal")[0].pose.position.x == 9
