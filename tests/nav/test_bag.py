"""What a replay writes, as `rosbags` reads it."""

from functools import partial

import numpy as np
import pytest
from rock_world import SMALL_RIG, RockWorld, body_pose

from marssim.base.bags.stereo_writer import StereoBagWriter
from marssim.base.rover_spec import ZHURONG
from nav.replay import Frame, main, replay, write_look

WORLD = RockWorld(domes=np.array([[5.0, 0.0, 0.6, 0.6]]))


def frames(steps=3):
    """Driving straight at a rock, with images of one level of grey each."""
    for step in range(steps):
        eye = body_pose(0.3 * step, 0, 0) @ ZHURONG.mount.left_eye(SMALL_RIG.baseline)
        image = np.full((192, 192, 3), step, np.uint8)
        yield Frame(WORLD.depth(SMALL_RIG, eye), None, SMALL_RIG, eye, images=(image, image + 1), time=2.5 * step)


@pytest.fixture(scope="module")
def replayed(tmp_path_factory):
    """Commands of a replay, and the messages of its bag by topic."""
    from rosbags.highlevel import AnyReader

    path = tmp_path_factory.mktemp("replay") / "bag"
    with StereoBagWriter(path) as bag:
        commands = replay(frames(), (20.0, 0.0), watch=partial(write_look, bag))
    found: dict[str, list] = {}
    with AnyReader([path]) as reader:
        for connection, time, raw in reader.messages():
            found.setdefault(connection.topic, []).append((time / 1e9, reader.deserialize(raw, connection.msgtype)))
    return commands, found


def test_each_frame_has_its_images_depth_and_pose_at_its_time(replayed):
    _, found = replayed
    for number, frame in enumerate(frames()):
        for topic in ("/stereo/left/image_rect", "/stereo/depth/image_rect", "/ground_truth/pose", "/tf", "/cmd_vel"):
            assert found[topic][number][0] == 1 + 2.5 * number
        assert set(found["/stereo/left/image_rect"][number][1].data) == {number}
        assert set(found["/stereo/right/image_rect"][number][1].data) == {number + 1}
        depth = found["/stereo/depth/image_rect"][number][1].data.view("<f4").reshape(192, 192)
        np.testing.assert_array_equal(depth, frame.depth.astype(np.float32))
        place = found["/ground_truth/pose"][number][1].pose.position
        assert (place.x, place.y, place.z) == pytest.approx((0.3 * number, 0, 0), abs=1e-9)


def test_commands_and_statuses_are_those_of_the_navigator_and_its_path_leads_round_the_rock(replayed):
    commands, found = replayed
    twists = [(message.linear.x, message.angular.z) for _, message in found["/cmd_vel"]]
    assert twists == [(command.speed, command.yaw_rate) for command in commands] and commands[0].speed > 0
    assert [message.data for _, message in found["/navigator/status"]] == [command.status for command in commands]
    path = found["/navigator/path"][-1][1]
    points = np.array([(p.pose.position.x, p.pose.position.y) for p in path.poses])
    assert path.header.frame_id == "odom" and np.hypot(*(points[0] - (0.6, 0))) < 0.2 and points[-1, 0] > 8
    assert np.hypot(*(points - (5.0, 0.0)).T).min() > 0.6  # the rock's radius


def test_a_path_that_exists_is_refused_before_anything_is_read(tmp_path, capsys):
    (tmp_path / "bag").mkdir()
    assert main([str(tmp_path / "no-dataset"), "--bag", str(tmp_path / "bag")]) == 2
    assert (
        capsys.readouterr().err == f"error: {tmp_path / 'bag'}: is there already; choose another folder for the bag\n"
    )
