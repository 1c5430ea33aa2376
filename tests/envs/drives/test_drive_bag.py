"""The bag of a drive against the environment that it was written from, as `rosbags` reads it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from envs.drivers.builtin import NavigatorDriver, StraightDriver
from envs.drives.drive_bag import DriveBag
from envs.world.eyes import EyesConfig

SMALL = EyesConfig(image_pixels=128, ground_truth_pixels=64)


def messages(path):
    """Time [s] and message by topic."""
    from rosbags.highlevel import AnyReader

    found = {}
    with AnyReader([path]) as reader:
        for connection, time, raw in reader.messages():
            found.setdefault(connection.topic, []).append((time / 1e9, reader.deserialize(raw, connection.msgtype)))
    return found


def driven(env, driver, path, steps=3):
    """Drive some steps; return the believed and true poses, the sights and the navigator's commands."""
    seen, observation = [], env._observation()
    driver.reset(env, 0)
    with DriveBag(path) as bag:
        bag.watch(env, driver, 0)
        for step in range(1, steps + 1):
            seen.append((env.believed_pose.copy(), env.vehicle.state().pose.copy(), env.sight, env.gaze.fresh))
            action = driver.act(env, observation)
            observation = env.step(action)[0]
            bag.watch(env, driver, step)
        bag.watch(env, driver, steps)  # as run_episode does where the driver ends the drive
        bag.end("no_path")
    return seen


def pose(position, turn):
    out = np.eye(4)
    out[:3, :3] = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix()
    out[:3, 3] = position.x, position.y, position.z
    return out


def test_a_drive_is_written_as_it_was_seen_believed_and_decided(on_course, make_scene, make_course, tmp_path):
    course = make_course(make_scene(rocks=[(1.5, 0.0, 1.2, 0.8)]), start=(-3.0, 0.0, 0.3), goal=(4.0, 0.0))
    env = on_course(course, mast=True, drift=0.3, yaw_drift_deg=5, eyes=SMALL)
    driver = NavigatorDriver()
    seen, found = driven(env, driver, tmp_path / "bag"), messages(tmp_path / "bag")
    for number, (believed, true, sight, _) in enumerate(seen):
        assert found["/odom"][number][0] == 1 + 2 * number
        odometry, truth = found["/odom"][number][1].pose.pose, found["/ground_truth/pose"][number][1].pose
        np.testing.assert_allclose(pose(odometry.position, odometry.orientation), believed, atol=1e-9)
        np.testing.assert_allclose(pose(truth.position, truth.orientation), true, atol=1e-9)
        correction = found["/tf"][number][1].transforms[0]
        assert (correction.header.frame_id, correction.child_frame_id) == ("map", "odom")
        np.testing.assert_allclose(
            pose(correction.transform.translation, correction.transform.rotation) @ believed, true, atol=1e-9
        )
        image = found["/stereo/depth/image_rect"][number][1]
        np.testing.assert_array_equal(image.data.view("<f4").reshape(image.height, image.width), sight.depth)
        assert (image.width, found["/stereo/left/image_rect"][number][1].width) == (64, 128)
    assert not np.allclose(seen[-1][0], seen[-1][1])  # the odometry drifted
    goal = found["/navigator/goal"][0][1]
    assert goal.header.frame_id == "map" and (goal.pose.position.x, goal.pose.position.y) == (4, 0)
    # each command stands at the time of the look that it follows from
    assert [time for time, _ in found["/cmd_vel"]] == [1, 3, 5, 7] == [time for time, _ in found["/navigator/status"]]
    last = found["/cmd_vel"][2][1]
    command = driver.navigator.last_command
    assert (last.linear.x, last.angular.z) == pytest.approx((command.speed, command.yaw_rate), abs=1e-6)
    assert found["/navigator/status"][2][1].data == command.status
    assert found["/navigator/status"][-1][1].data == "no_path" and found["/cmd_vel"][-1][1].linear.x == 0
    path = found["/navigator/path"][0][1].poses
    assert len(path) > 5 and abs(path[0].pose.position.x + 3) < 0.2


def test_a_driver_without_a_navigator_has_commands_and_no_path_and_between_looks_there_are_no_images(
    on_course, make_scene, make_course, tmp_path
):
    eyes = replace(SMALL, look_every=0.7)
    env = on_course(make_course(make_scene(), start=(-3.0, 0.0, 0.0), goal=(4.0, 0.0)), mast=True, eyes=eyes)
    seen = driven(env, StraightDriver(), tmp_path / "bag")
    found = messages(tmp_path / "bag")
    assert "/navigator/path" not in found and {m.data for _, m in found["/navigator/status"][:3]} == {"drive"}
    assert [m.linear.x for _, m in found["/cmd_vel"]] == pytest.approx([env.rover_spec.max_speed] * 3 + [0])
    looked = [1 + 2 * n for n, (*_, fresh) in enumerate(seen) if fresh] + ([7] if env.gaze.fresh else [])
    assert [time for time, _ in found["/stereo/left/image_rect"]] == looked and len(looked) < 4
    assert [time for time, _ in found["/tf"]] == [1, 3, 5, 7]
