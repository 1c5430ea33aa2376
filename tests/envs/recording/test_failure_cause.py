from types import SimpleNamespace

import numpy as np
import pytest
from rock_world import SMALL_RIG, RockWorld, body_pose

from envs.comparison.schema import results_schema
from envs.drives.episodes import Cause
from envs.recording.failure_cause import IN_WORDS, TrueDepthMap, _room
from envs.world.perception import Sight
from marssim.base.dataset.drive_file import drive_schema
from marssim.base.rover_spec import ZHURONG
from nav.ground.elevation import ElevationConfig, ElevationMap
from nav.navigator import Navigator, NavigatorConfig

SMALL = NavigatorConfig(elevation=ElevationConfig(size=24.0, recentre_at=8.0))  # of a small map, which is quicker
AREA = (-4.0, -3.0, 9.0, 3.0)
PLAIN = RockWorld()
WALL = RockWorld(boxes=np.array([[4.0, 0.0, 0.3, 6.0, 0.6]]))  # from border to border
AHEAD = RockWorld(domes=np.array([[2.2, 0.0, 0.4, 0.5]]))


def driven(true, believed, at=0.0, unknown=None, area=AREA, prior=None, drift=(0.0, 0.0)):
    """Return the maps and the environment after a drive of 2.75 m straight ahead to x = `at` [m], with the depth of
    another world.

    unknown: a function of the x of what pixels see [m] that tells where the depth is unknown.
    drift: what the odometry adds to x and y with each step [m].
    """
    env = SimpleNamespace(rover_spec=ZHURONG, gaze=SimpleNamespace(pan=0.0, fresh=True))
    env.course = SimpleNamespace(area=area, goal=np.array([8.0, 0.0]))
    navigator = Navigator(ZHURONG, SMALL, area=area, prior=prior)
    beside = TrueDepthMap(navigator)
    for step, pan in enumerate((0.6, 0.0, -0.6, 0.0) * 3):
        x = at - 0.25 * (11 - step)  # it moves at each step, or the navigator would note that it bumped into something
        pose, env.gaze.pan = body_pose(x, 0.0, 0.0), pan
        env.vehicle = SimpleNamespace(state=lambda pose=pose: SimpleNamespace(pose=pose))
        env.believed_pose = body_pose(x + step * drift[0], step * drift[1], 0.0)
        eye = pose @ ZHURONG.mount.left_eye(SMALL_RIG.baseline, pan)
        depth, truth = (world.depth(SMALL_RIG, eye) for world in (believed, true))
        if unknown is not None:
            ground_x = eye[0, 3] + depth * (SMALL_RIG.camera.rays() @ eye[:3, :3].T)[..., 0]
            depth = np.where(unknown(ground_x), np.nan, depth)
        env.sight = Sight(depth, np.ones_like(depth), SMALL_RIG, eye, pan, true_depth=truth)
        navigator.step(depth, None, SMALL_RIG, env.believed_pose, env.course.goal, pan)
        beside.see(env)
    return beside, env


def cause_of(drive, outcome):
    """Return the cause of a drive of `driven` that ends so."""
    beside, env = drive
    env.outcome = outcome
    return beside.cause(env)


@pytest.fixture(scope="module")
def plain_drive():
    """A drive over ground that is seen as it is."""
    return driven(PLAIN, PLAIN)


@pytest.mark.parametrize("at", [0.0, 2.3, 2.6])
def test_a_wall_that_is_not_there_blocks_the_path(at):
    drive = driven(PLAIN, WALL, at)
    assert cause_of(drive, "no_path") is cause_of(drive, "stuck") is Cause.FALSE_OBSTACLES


@pytest.mark.parametrize("ground", [0.0, 0.25])
def test_obstacles_that_are_not_there_are_named_where_the_heights_around_them_err_too(ground):
    high = [8.0, 0.0, 4.5, 9.0, ground]  # a plateau from 3.5 m on
    wall = [5.0, 0.0, 0.3, 6.0, ground + 0.6]
    drive = driven(PLAIN, RockWorld(boxes=np.array([high, wall])), at=1.2)
    assert cause_of(drive, "no_path") is Cause.FALSE_OBSTACLES


def test_a_true_wall_blocks_the_path_with_true_depth_too():
    assert cause_of(driven(WALL, WALL), "no_path") is Cause.NO_TRUE_PATH
    assert cause_of(driven(WALL, PLAIN), "no_path") is Cause.DETOUR  # its own map shows a path


def test_a_rover_that_ran_out_of_time_on_open_ground_took_a_detour(plain_drive):
    assert cause_of(plain_drive, "time") is Cause.DETOUR
    for left in (2.5, 1.8, 1.2):  # near the goal, motions lead beyond it
        drive = driven(PLAIN, PLAIN, 8.0 - left, area=(-9.0, -9.0, 19.0, 9.0))
        assert cause_of(drive, "time") is Cause.DETOUR


def test_a_rover_that_is_stuck_on_open_ground_made_no_progress(plain_drive):
    assert cause_of(plain_drive, "stuck") is Cause.NO_PROGRESS


def test_ground_that_is_left_without_knowing_it_is_an_error_of_the_odometry(plain_drive):
    assert cause_of(plain_drive, "out_of_bounds") is Cause.ODOMETRY
    beyond = driven(PLAIN, PLAIN, area=(-4.0, -3.0, -0.5, 3.0))
    assert cause_of(beyond, "out_of_bounds") is not Cause.ODOMETRY


def test_ground_without_depth_before_the_rover_blocks_the_path():
    drive = driven(PLAIN, PLAIN, at=1.2, unknown=lambda x: x > 2.2)
    assert cause_of(drive, "time") is Cause.UNMEASURED_GROUND


def test_false_obstacles_and_unmeasured_ground_may_block_the_path_together():
    drive = driven(PLAIN, WALL, at=1.2, unknown=lambda x: (x > 2.2) & (x < 3.6))
    assert cause_of(drive, "no_path") is Cause.BOTH


@pytest.mark.parametrize(
    ("true", "believed", "cause"),
    [
        (AHEAD, AHEAD, Cause.KNOWN_OBSTACLE),
        (AHEAD, PLAIN, Cause.MISSED_OBSTACLE),
        (PLAIN, PLAIN, Cause.UNSEEN_OBSTACLE),
    ],
)
def test_what_the_rover_hit_is_looked_up_on_both_maps(true, believed, cause):
    drive = driven(true, believed, at=0.9)
    assert cause_of(drive, "collision") is cause_of(drive, "tilt") is cause


@pytest.mark.parametrize("gap", [0.2, 0.35])
def test_a_known_rock_beside_the_rover_does_not_hide_the_missed_one_before_it(gap):
    beside = [0.9, ZHURONG.width / 2 + 0.3 + gap, 0.3, 0.5]
    true = RockWorld(domes=np.array([[2.1, 0.0, 0.4, 0.5], beside]))
    drive = driven(true, RockWorld(domes=np.array([beside])), at=0.9)
    assert cause_of(drive, "collision") is Cause.MISSED_OBSTACLE


def test_an_obstacle_elsewhere_is_not_what_the_rover_hit():
    assert cause_of(driven(AHEAD, AHEAD), "collision") is Cause.UNSEEN_OBSTACLE


def test_a_drive_that_ends_elsewhere_was_led_there_by_its_odometry(plain_drive):
    assert cause_of(plain_drive, "elsewhere") is Cause.ODOMETRY


@pytest.mark.parametrize(("drift", "cause"), [((-0.08, 0.0), Cause.ODOMETRY), ((0.0, 1e-9), Cause.KNOWN_OBSTACLE)])
def test_an_obstacle_that_only_a_map_of_true_poses_shows_was_hit_by_wrong_odometry(drift, cause):
    """The rover believed that it had not gone so far; the rock was never between the places of its looks and itself."""
    assert cause_of(driven(AHEAD, AHEAD, at=0.9, drift=drift), "collision") is cause


def test_what_no_map_shows_is_unseen_whatever_the_odometry():
    assert cause_of(driven(PLAIN, PLAIN, at=0.9, drift=(-0.08, 0.0)), "collision") is Cause.UNSEEN_OBSTACLE


def test_an_arrival_and_a_drive_that_has_not_begun_have_no_cause(plain_drive):
    assert cause_of(plain_drive, "goal") is None
    env = SimpleNamespace(course=SimpleNamespace(area=AREA), outcome="collision")
    assert TrueDepthMap(Navigator()).cause(env) is None


def test_a_navigator_that_knew_heights_before_the_drive_has_no_cause():
    assert cause_of(driven(PLAIN, WALL, prior=ElevationMap()), "no_path") is None


def test_a_recorded_crash_of_the_navigator_names_the_rock_that_its_eyes_missed(blind_crash, crash, arrival):
    drive, record = blind_crash
    assert record.outcome == "collision" and drive.content["episode"]["cause"] == "missed obstacle"
    assert arrival[0].content["episode"]["cause"] is None
    assert crash[0].content["episode"]["cause"] is None


def test_every_cause_has_words_and_a_place_in_the_schemas():
    of_drive = drive_schema()["properties"]["episode"]["properties"]["cause"]["enum"]
    of_results = results_schema()["properties"]["episodes"]["items"]["properties"]["cause"]["enum"]
    assert set(IN_WORDS) == set(Cause) and of_drive == of_results == [None, *Cause]


def test_ground_may_be_left_to_either_side():
    for area in ((-4.0, 0.5, 9.0, 3.0), (-4.0, -3.0, 9.0, -0.5)):  # the rover is at y = 0
        assert cause_of(driven(PLAIN, PLAIN, area=area), "out_of_bounds") is not Cause.ODOMETRY


def test_between_looks_nothing_is_added():
    beside, env = driven(PLAIN, PLAIN)
    before = beside._map.top.copy()
    env.gaze.fresh, env.sight = False, driven(WALL, WALL)[1].sight
    beside.see(env)
    np.testing.assert_array_equal(beside._map.top, before)


def test_the_room_of_a_place_is_its_distance_from_the_footprint_as_the_rover_is_turned():
    navigator, yaw = Navigator(), np.pi / 4
    place = np.array([1.0, 2.0, yaw])
    ahead, left = np.array([np.cos(yaw), np.sin(yaw)]), np.array([-np.sin(yaw), np.cos(yaw)])
    room = _room(place[:2] + 2.0 * np.array([ahead, left, -left]), place, navigator)
    # the discs of the footprint reach 8 cm beyond its ends, and 6 cm beyond its sides
    beyond = np.array([ZHURONG.length / 2 + 0.08, ZHURONG.width / 2 + 0.06, ZHURONG.width / 2 + 0.06])
    assert room == pytest.approx(2.0 - beyond, abs=0.04)


def test_the_map_of_true_depth_follows_the_rover():
    env = SimpleNamespace(gaze=SimpleNamespace(pan=0.0, fresh=True), sight=SimpleNamespace(rig=SMALL_RIG))
    beside = TrueDepthMap(Navigator(ZHURONG, SMALL))
    for x in np.arange(0.0, 32.0, 2.0):
        env.believed_pose = pose = body_pose(x, 0.0, 0.0)
        env.vehicle = SimpleNamespace(state=lambda pose=pose: SimpleNamespace(pose=pose))
        env.sight.true_depth = PLAIN.depth(SMALL_RIG, env.believed_pose @ ZHURONG.mount.left_eye(SMALL_RIG.baseline))
        beside.see(env)
        column, row = beside._map.cell_of(np.array([x + 4.0, 0.0]))
        assert beside._map.known[row - 2 : row + 3, column - 2 : column + 3].any()
