from types import SimpleNamespace

import numpy as np
import pytest
from rock_world import SMALL_RIG, RockWorld, body_pose

from envs.drivers.builtin import NavigatorDriver, StraightDriver
from envs.recording.failure_cause import IN_WORDS, Cause, TrueDepthBeside
from envs.world.perception import Sight
from marssim.base.dataset.drive_file import drive_schema
from marssim.base.rover_spec import ZHURONG

AREA = (-4.0, -3.0, 9.0, 3.0)
PLAIN = RockWorld()
WALL = RockWorld(boxes=np.array([[4.0, 0.0, 0.3, 6.0, 0.6]]))  # from border to border
AHEAD = RockWorld(domes=np.array([[2.2, 0.0, 0.4, 0.5]]))


def end_of(true, believed, outcome, at=0.0, unknown=None):
    """Return the cause of a drive of 2.75 m straight ahead to x = `at` [m], with the depth of another world.

    unknown: a function of the x of what pixels see [m] that tells where the depth is unknown.
    """
    env = SimpleNamespace(rover_spec=ZHURONG, outcome="driving", gaze=SimpleNamespace(pan=0.0, fresh=True))
    env.course = SimpleNamespace(area=AREA, goal=np.array([8.0, 0.0]))
    driver, beside = NavigatorDriver(), TrueDepthBeside(env)
    driver.reset(env, 0)
    for step, pan in enumerate((0.6, 0.0, -0.6, 0.0) * 3):
        x = at - 0.25 * (11 - step)  # it moves at each step, or the navigator would note that it bumped into something
        env.believed_pose, env.gaze.pan = body_pose(x, 0.0, 0.0), pan
        eye = env.believed_pose @ ZHURONG.mount.left_eye(SMALL_RIG.baseline, pan)
        depth, truth = (world.depth(SMALL_RIG, eye) for world in (believed, true))
        if unknown is not None:
            ground_x = eye[0, 3] + depth * (SMALL_RIG.camera.rays() @ eye[:3, :3].T)[..., 0]
            depth = np.where(unknown(ground_x), np.nan, depth)
        env.sight = Sight(depth, np.ones_like(depth), SMALL_RIG, eye, pan, true_depth=truth)
        driver.act(env, {})
        beside.see(env)
    env.outcome = outcome
    return beside.cause(env, driver)


@pytest.mark.parametrize("outcome", ["no_path", "time", "stuck"])
def test_a_wall_that_is_not_there_blocks_the_path(outcome):
    assert end_of(PLAIN, WALL, outcome) is Cause.FALSE_OBSTACLES


def test_a_true_wall_blocks_the_path_with_true_depth_too():
    assert end_of(WALL, WALL, "no_path") is Cause.NO_TRUE_PATH
    assert end_of(WALL, PLAIN, "no_path") is Cause.DETOUR  # its own map shows a path


def test_a_rover_that_ran_out_of_time_on_open_ground_took_a_detour():
    assert end_of(PLAIN, PLAIN, "time") is Cause.DETOUR


def test_ground_without_depth_before_the_rover_blocks_the_path():
    assert end_of(PLAIN, PLAIN, "time", at=1.2, unknown=lambda x: x > 2.2) is Cause.UNMEASURED_GROUND


def test_false_obstacles_and_unmeasured_ground_may_block_the_path_together():
    assert end_of(PLAIN, WALL, "no_path", at=1.2, unknown=lambda x: (x > 2.2) & (x < 3.6)) is Cause.BOTH


@pytest.mark.parametrize(
    ("true", "believed", "cause"),
    [
        (AHEAD, AHEAD, Cause.KNOWN_OBSTACLE),
        (AHEAD, PLAIN, Cause.MISSED_OBSTACLE),
        (PLAIN, PLAIN, Cause.UNSEEN_OBSTACLE),
    ],
)
@pytest.mark.parametrize("outcome", ["collision", "tilt"])
def test_what_the_rover_hit_is_looked_up_on_both_maps(true, believed, cause, outcome):
    assert end_of(true, believed, outcome, at=0.9) is cause


def test_an_obstacle_elsewhere_is_not_what_the_rover_hit():
    assert end_of(AHEAD, AHEAD, "collision", at=0.0) is Cause.UNSEEN_OBSTACLE


def test_a_drive_that_ends_elsewhere_was_led_there_by_its_odometry():
    assert end_of(PLAIN, PLAIN, "elsewhere") is Cause.ODOMETRY


def test_an_arrival_and_other_drivers_have_no_cause():
    assert end_of(PLAIN, PLAIN, "goal") is None
    env = SimpleNamespace(rover_spec=ZHURONG, course=SimpleNamespace(area=AREA), outcome="collision")
    assert TrueDepthBeside(env).cause(env, StraightDriver()) is None
    assert TrueDepthBeside(env).cause(env, NavigatorDriver()) is None  # it has not decided anything


def test_a_recorded_crash_of_the_navigator_names_the_rock_that_its_eyes_missed(blind_crash, crash, arrival):
    drive, record = blind_crash
    assert record.outcome == "collision" and drive.content["episode"]["cause"] == "missed obstacle"
    assert arrival[0].content["episode"]["cause"] is None
    assert crash[0].content["episode"]["cause"] is None


def test_every_cause_has_words_and_a_place_in_the_schema():
    listed = drive_schema()["properties"]["episode"]["properties"]["cause"]["enum"]
    assert set(IN_WORDS) == set(Cause) and listed == [None, *Cause]
