import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from rock_world import SMALL_RIG, RockWorld, body_pose

from marssim.base.rover_spec import ZHURONG
from nav import ElevationConfig, ElevationMap, Navigator, NavigatorConfig
from nav.ground.traversability import _ground_cost
from nav.path.footprint import arc_poses
from nav.path.planner import Motion

GOAL = np.array([20.0, 0.0])
NEAR_GOAL = np.array([14.0, 0.0])
# Smaller than the drive, so that the map scrolls and the goal lies outside it at first; and quicker.
SMALL = NavigatorConfig(elevation=ElevationConfig(size=24.0, recentre_at=8.0))


def random_rocks(seed, count=10):
    """Rocks on the way from (0, 0) to NEAR_GOAL, which are clear within 2.5 m."""
    rng, rocks = np.random.default_rng(seed), []
    while len(rocks) < count:
        height = rng.uniform(0.3, 0.6)
        rock = [rng.uniform(1, NEAR_GOAL[0] - 1), rng.uniform(-4, 4), height * rng.uniform(0.9, 1.2), height]
        if np.hypot(*rock[:2]) > 2.5 + rock[2] and np.hypot(rock[0] - NEAR_GOAL[0], rock[1]) > 2.5 + rock[2]:
            rocks.append(rock)
    return RockWorld(np.array(rocks))


def drive(world, goal=GOAL, yaw=0.0, steps=120, mast=True, blocked_at=None):
    """Drive a unicycle; returns the last status, the poses, the commands and whether a rock was touched. A mast that
    is stuck looks ahead; blocked_at: x where an invisible wall, 2 m wide, stops the rover's centre."""
    navigator, here, pan = Navigator(config=SMALL), np.array([0.0, 0.0, yaw]), 0.0
    track, commands = [here], []
    for _ in range(steps):
        pose = body_pose(*here)
        depth = world.depth(SMALL_RIG, pose @ ZHURONG.mount.left_eye(SMALL_RIG.baseline, pan))
        command = navigator.step(depth, None, SMALL_RIG, pose, goal, pan)
        commands.append(command)
        assert abs(command.speed) <= ZHURONG.max_speed + 1e-9 and abs(command.yaw_rate) <= ZHURONG.max_yaw_rate + 1e-9
        if command.status in ("arrived", "stuck", "no_path"):
            break
        pan = (command.pan or 0.0) if mast else 0.0
        for _ in range(4):
            if command.speed:
                new = arc_poses(here, np.array(command.yaw_rate / command.speed), np.array([command.speed * 0.5]))[0]
            else:
                new = here + np.array([0, 0, command.yaw_rate * 0.5])
            if blocked_at is not None and blocked_at < new[0] < blocked_at + 0.5 and abs(new[1]) < 1.0:
                continue
            here = new
            track.append(here)
            if world.touches(*here, ZHURONG.length, ZHURONG.width):
                return "touched", np.array(track), commands
    return commands[-1].status, np.array(track), commands


def test_arrives_among_rocks_without_touching_one():
    outcomes = [drive(random_rocks(seed), NEAR_GOAL)[0] for seed in range(3)]
    assert "touched" not in outcomes
    assert outcomes.count("arrived") >= 2


@pytest.mark.parametrize("near", [1.9, 5.0])
def test_goes_round_a_trench(near):
    """The nearer one begins on ground that is assumed flat, as the cameras do not show it at the start."""
    trench = np.array([[near + 0.6, 1.0, 0.6, 3.0, 1.0]])
    status, track, _ = drive(RockWorld(trenches=trench), goal=np.array([10.0, 0.0]), steps=60)
    assert status == "arrived"
    assert track[:, 1].min() < -2.0 - ZHURONG.width / 2


def test_drives_straight_where_nothing_is():
    status, track, commands = drive(RockWorld(), goal=np.array([8.0, 0.0]))
    assert status == "arrived"
    assert len(commands) <= 7.5 / 0.4 + 4
    assert 7.4 < track[-1, 0] < 7.7  # within half a metre, whatever its odometry lacks of a metre
    assert np.abs(track[:, 1]).max() < 0.3


def test_a_goal_behind_without_a_mast_that_pans():
    status, track, _ = drive(RockWorld(), goal=np.array([-6.0, 1.0]), mast=False, steps=50)
    assert status == "arrived"
    assert np.abs(track[:, 0]).max() < 7


def test_the_mast_looks_into_a_turn_before_it():
    _, _, commands = drive(RockWorld(), goal=np.array([0.0, 8.0]), steps=4)
    pans = [c.pan for c in commands if c.pan is not None]
    assert pans and max(pans) > np.deg2rad(15) and min(pans) > -np.deg2rad(15)


def test_backs_out_of_a_dead_end():
    wall = [[5.0, y, 0.4, 0.5] for y in np.arange(-2.8, 2.9, 0.5)]
    sides = [[x, y, 0.4, 0.5] for x in np.arange(3.0, 5.0, 0.5) for y in (-2.8, 2.8)]
    status, _, _ = drive(RockWorld(np.array(wall + sides)), goal=np.array([10.0, 0.0]), steps=150)
    assert status == "arrived"


def test_a_rover_walled_in_ends_with_no_path():
    ring = [[3.2 * np.cos(a), 3.2 * np.sin(a), 0.5, 0.6] for a in np.linspace(0, 2 * np.pi, 32)]
    status, _, commands = drive(RockWorld(np.array(ring)), steps=150)
    assert status == "no_path"
    assert commands[-1].speed == 0 and commands[-1].yaw_rate == 0


def test_an_unseen_wall_is_noticed_by_standing_still_and_driven_round():
    status, track, commands = drive(RockWorld(), goal=np.array([8.0, 0.0]), blocked_at=3.0, steps=100)
    assert any(c.status == "recover" and c.speed < 0 for c in commands)
    assert status == "arrived"
    assert np.abs(track[:, 1]).max() > 0.9


@pytest.mark.parametrize("depth", [None, np.full((192, 192), np.nan), np.full((192, 192), np.inf)])
def test_a_rover_without_depth_stands_still(depth):
    command = Navigator().step(depth, None, SMALL_RIG, body_pose(0, 0, 0), GOAL)
    assert (command.speed, command.yaw_rate, command.status) == (0.0, 0.0, "blind")


@pytest.mark.parametrize(("goal", "status"), [(GOAL, "blind"), (np.array([13.2, 0.0]), "arrived")])
def test_a_step_that_decides_nothing_judges_the_ground_of_its_place(goal, status):
    """The map may have scrolled in it, which that of an earlier step would not show."""
    navigator, camera = Navigator(), ZHURONG.mount.left_eye(SMALL_RIG.baseline)
    for x in (12.4, 12.8):
        pose = body_pose(x, 0, 0)
        navigator.step(RockWorld().depth(SMALL_RIG, pose @ camera), None, SMALL_RIG, pose, np.add(goal, (30, 0)))
    before = navigator.map.origin.copy()
    for x in np.arange(13.2, 30, 0.4):
        there = np.add(goal, (x - 13.2, 0))
        assert navigator.step(None, None, SMALL_RIG, body_pose(x, 0, 0), there).status == status
        if not np.array_equal(navigator.map.origin, before):
            break
    assert not np.array_equal(navigator.map.origin, before)
    expected = navigator.judge(np.array([x, 0.0, 0.0]))
    np.testing.assert_array_equal(navigator.ground.cost, expected.cost)


def test_poses_may_lie_far_from_the_origin_as_those_of_a_map_projection():
    pose = body_pose(5e5, 4.2e6, 0)
    depth = RockWorld().depth(SMALL_RIG, ZHURONG.mount.left_eye(SMALL_RIG.baseline))
    assert Navigator().step(depth, None, SMALL_RIG, pose, pose[:2, 3] + (20, 0)).status == "drive"


def test_an_image_that_was_lost_counts_as_no_look():
    navigator = Navigator()
    navigator.step(None, None, SMALL_RIG, body_pose(0, 0, 0), GOAL)
    assert not navigator.looks.cover(np.zeros(3), 0.0)
    depth = RockWorld().depth(SMALL_RIG, ZHURONG.mount.left_eye(SMALL_RIG.baseline))
    navigator.step(depth, None, SMALL_RIG, body_pose(0, 0, 0), GOAL)
    assert navigator.looks.cover(np.zeros(3), 0.0)
    navigator = Navigator()
    navigator.step(np.full((192, 192), np.nan), None, SMALL_RIG, body_pose(0, 0, 0), GOAL)
    assert navigator.looks.cover(np.zeros(3), 0.0)  # it was taken, and shows nothing


@pytest.mark.parametrize("distance", [3.5, 4.0, 20.0])
def test_a_rover_that_holds_a_command_for_long_drives_no_farther_than_it_knows_to_be_free(distance):
    navigator = Navigator(config=replace(NavigatorConfig.of_rover(ZHURONG), step_time=10.0))
    depth = wall(1.0, distance).depth(SMALL_RIG, ZHURONG.mount.left_eye(SMALL_RIG.baseline))
    command = navigator.step(depth, None, SMALL_RIG, np.eye(4), GOAL)
    assert command.status == "drive" and navigator.motion is not None
    assert 0.5 < 10.0 * command.speed <= navigator.motion.length + 1e-9


def test_a_rover_that_another_driver_moves_meets_nothing_by_standing_still():
    navigator, depth = Navigator(), RockWorld().depth(SMALL_RIG, ZHURONG.mount.left_eye(SMALL_RIG.baseline))
    for _ in range(6):
        command = navigator.step(depth, None, SMALL_RIG, np.eye(4), GOAL, obeyed=False)
        assert command.status == "drive" and not navigator.recovery.bumps
    for _ in range(3):
        navigator.step(depth, None, SMALL_RIG, np.eye(4), GOAL)
    assert navigator.recovery.bumps


def test_a_mast_that_another_driver_moves_is_not_taken_for_broken():
    depth = RockWorld().depth(SMALL_RIG, ZHURONG.mount.left_eye(SMALL_RIG.baseline))
    for obeyed in (True, False):
        navigator = Navigator()
        for _ in range(4):  # the goal lies behind, so that the mast shall look there, and never does
            navigator.step(depth, None, SMALL_RIG, np.eye(4), (-8.0, 8.0), obeyed=obeyed)
        assert navigator.mast.obeys != obeyed


def test_looks_to_the_sides_that_another_driver_does_not_take_count_as_taken(monkeypatch):
    navigator, depth = Navigator(), RockWorld().depth(SMALL_RIG, ZHURONG.mount.left_eye(SMALL_RIG.baseline))
    monkeypatch.setattr(navigator.planner, "plan", lambda *_: None)  # a dead end
    commands = [navigator.step(depth, None, SMALL_RIG, np.eye(4), GOAL, obeyed=False) for _ in range(3)]
    assert [command.status for command in commands] == ["look", "look", "recover"]
    assert commands[0].pan == -commands[1].pan == pytest.approx(np.deg2rad(navigator.config.look_pan_deg))


def test_a_recovery_counts_the_way_back_of_steps_without_an_image():
    navigator = Navigator(config=replace(NavigatorConfig.of_rover(ZHURONG), back_up=0.5))
    for x in np.arange(0.0, 4.0, 0.2):
        navigator.recovery.follow(np.array([x, 0.0, 0.0]))
    navigator.recovery.start(np.array([4.0, 0.0, 0.0]))
    x, driven = 4.0, 0.0
    for n in range(30):
        pose = body_pose(x, 0.0, 0.0)
        depth = RockWorld().depth(SMALL_RIG, pose @ ZHURONG.mount.left_eye(SMALL_RIG.baseline))
        command = navigator.step(None if n % 2 else depth, None, SMALL_RIG, pose, (12.0, 0.0))
        if command.status not in ("recover", "blind"):
            break
        x += command.speed * navigator.config.step_time
        driven -= command.speed * navigator.config.step_time
    assert driven == pytest.approx(0.6) and n == 4  # steps of 0.3 m, each with a blind one after it


def test_between_two_looks_the_rover_drives_on_by_its_map():
    navigator, world = Navigator(), RockWorld()
    eye = body_pose(0, 0, 0) @ ZHURONG.mount.left_eye(SMALL_RIG.baseline, 0.0)
    navigator.step(world.depth(SMALL_RIG, eye), None, SMALL_RIG, body_pose(0, 0, 0), GOAL)
    command = navigator.step(None, None, SMALL_RIG, body_pose(0.4, 0, 0), GOAL, between_looks=True)
    assert command.status == "drive" and command.speed > 0.1


def statuses_between_looks(monkeypatch, motion):
    """The statuses of a rover on an open plain, 1.2 m from its last look and farther, where `motion` is the best one.

    It takes an image only after it has asked for one.
    """
    navigator, statuses = Navigator(config=SMALL), []
    for x in (0.0, 1.2, 1.5, 1.8):
        fresh = not statuses or statuses[-1] == "look"
        pose = body_pose(x, 0, 0)
        depth = RockWorld().depth(SMALL_RIG, pose @ ZHURONG.mount.left_eye(SMALL_RIG.baseline)) if fresh else None
        command = navigator.step(depth, None, SMALL_RIG, pose, GOAL, 0.0, between_looks=not fresh)
        statuses.append(command.status)
        monkeypatch.setattr(navigator.planner, "plan", lambda *_: motion)
    return statuses[1:]


@pytest.mark.parametrize(("turn", "length", "status"), [(0.4, 4.0, "turn"), (0.0, 1.0, "drive")])
def test_between_two_looks_the_rover_looks_before_a_turn_or_a_short_way_but_once(monkeypatch, turn, length, status):
    """The map has shown such a way, so that nothing new would be seen if it went: it could go to and fro for ever."""
    motion = Motion(0.0, turn, length, 0.0, np.zeros((2, 3)))
    assert statuses_between_looks(monkeypatch, motion) == ["look", status, status]


def test_between_two_looks_a_long_free_way_needs_no_look(monkeypatch):
    motion = Motion(0.0, 0.0, 4.0, 0.0, np.zeros((2, 3)))
    assert statuses_between_looks(monkeypatch, motion) == ["drive"] * 3


def test_between_two_looks_a_mast_that_is_stuck_looks_once_where_it_points(monkeypatch):
    monkeypatch.setattr("nav.mast.Mast.follow", lambda mast, *_: setattr(mast, "obeys", False))
    motion = Motion(0.0, 0.4, 4.0, 0.0, np.zeros((2, 3)))
    assert statuses_between_looks(monkeypatch, motion) == ["look", "turn", "turn"]


def test_arrived_within_the_radius_and_not_before():
    navigator = Navigator()
    assert navigator.step(None, None, SMALL_RIG, body_pose(19.6, 0, 0), GOAL).status == "arrived"
    navigator.reset()
    assert navigator.step(None, None, SMALL_RIG, body_pose(19.4, 0, 0), np.append(GOAL, 3.0)).status != "arrived"


def test_reset_forgets_map_and_track():
    world, navigator = RockWorld(domes=np.array([[5.0, 0.3, 0.5, 0.5]])), Navigator()
    pose = body_pose(0, 0, 0)
    depth = world.depth(SMALL_RIG, pose @ ZHURONG.mount.left_eye(SMALL_RIG.baseline))
    first = navigator.step(depth, None, SMALL_RIG, pose, GOAL)
    navigator.step(depth, None, SMALL_RIG, body_pose(1, 2, 1), GOAL)
    navigator.reset()
    assert navigator.step(depth, None, SMALL_RIG, pose, GOAL) == first


def test_wrong_input_is_refused_by_name():
    transposed, twice = body_pose(3, 1, 0).T, 2 * np.eye(4)
    for pose in (np.full((4, 4), np.nan), np.eye(3), transposed, twice, np.diag([1.0, 1, -1, 1])):
        with pytest.raises(ValueError, match="pose must be"):
            Navigator().step(None, None, SMALL_RIG, pose, GOAL)
    camera = ZHURONG.mount.left_eye(SMALL_RIG.baseline)
    with pytest.raises(ValueError, match=r"^pose must be body to world, .* is 110 deg from the vertical: is it"):
        Navigator().step(None, None, SMALL_RIG, camera, GOAL)
    assert Navigator().step(None, None, SMALL_RIG, camera @ np.linalg.inv(camera), [5.0, 0.0]).status == "blind"
    for pan in (np.nan, np.inf, 20.0, None):
        with pytest.raises(ValueError, match="pan must be an angle"):
            Navigator().step(None, None, SMALL_RIG, np.eye(4), GOAL, pan)
    with pytest.raises(ValueError, match="goal"):
        Navigator().step(None, None, SMALL_RIG, np.eye(4), np.array([np.inf, 0]))
    size = SMALL_RIG.camera.height, SMALL_RIG.camera.width
    with pytest.raises(ValueError, match="depth must be metres, as floating point, got uint16"):
        Navigator().step(np.full(size, 4000, np.uint16), None, SMALL_RIG, np.eye(4), GOAL)
    with pytest.raises(ValueError, match="its largest value is 255"):
        Navigator().step(np.full(size, 4.0), np.full(size, 255, np.uint8), SMALL_RIG, np.eye(4), GOAL)


def test_the_goal_radius_of_the_settings_ends_the_drive():
    navigator = Navigator(config=NavigatorConfig(goal_radius=3.0))
    assert navigator.step(None, None, SMALL_RIG, body_pose(17.5, 0, 0), GOAL).status == "arrived"


def test_importing_nav_loads_neither_simulator_nor_torch():
    code = (
        "import sys, nav; print([m for m in ('pybullet', 'torch', 'm3depth', 'envs', 'gymnasium') if m in sys.modules])"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"


def test_a_turn_into_the_unseen_waits_for_a_look():
    """The goal lies behind, and the start's assumed clearing shows nothing there: first the mast, then the rover."""
    world, navigator, pan = RockWorld(), Navigator(config=SMALL), 0.0
    pose, seen = body_pose(0, 0, 0), []
    for _ in range(6):
        depth = world.depth(SMALL_RIG, pose @ ZHURONG.mount.left_eye(SMALL_RIG.baseline, pan))
        command = navigator.step(depth, None, SMALL_RIG, pose, np.array([-2.0, 9.0]), pan)
        seen.append(command.status)
        if command.status != "look":
            break
        wish = command.pan or 0.0
        pan += float(np.clip(wish - pan, -0.6, 0.6))  # a mast that takes three steps for 75 deg
    assert seen[0] == "look" and seen[-1] in ("turn", "drive") and abs(pan) > np.deg2rad(30)
    assert navigator.mast.obeys  # slow is not broken


def ways_round_a_wall(area):
    """y of the rover's middle over 30 steps towards a wall with a goal behind it."""
    wall = RockWorld(np.array([[5.0, y, 0.5, 0.6] for y in np.arange(-2.5, 3.6, 0.6)]))
    navigator, here, out = Navigator(config=SMALL, area=area), np.zeros(3), []
    for _ in range(30):
        pose = body_pose(*here)
        depth = wall.depth(SMALL_RIG, pose @ ZHURONG.mount.left_eye(SMALL_RIG.baseline))
        command = navigator.step(depth, None, SMALL_RIG, pose, np.array([10.0, 1.0]))
        if command.over:
            break
        if command.speed:
            here = arc_poses(here, np.array(command.yaw_rate / command.speed), np.array([2 * command.speed]))[0]
        else:
            here = here + np.array([0, 0, 2 * command.yaw_rate])
        out.append(here[1])
    return np.array(out)


def test_the_rover_stays_in_its_area():
    """The side on which the rover goes round a wall is closed: it keeps to the other."""
    free = ways_round_a_wall(None)
    side = 1 if free.max() > -free.min() else -1
    assert (side * free).max() > 2.1
    way_inside = ways_round_a_wall((-4.0, -8.0, 16.0, 2.0) if side > 0 else (-4.0, -2.0, 16.0, 8.0))
    assert (side * way_inside).max() < 2.1
    with pytest.raises(ValueError, match="area"):
        Navigator(area=(0, 0, 0, 1))


def test_too_few_points_count_as_no_depth():
    depth = np.full((192, 192), np.nan, np.float32)
    depth[150:154, 90:94] = 3.0
    assert Navigator().step(depth, None, SMALL_RIG, body_pose(0, 0, 0), GOAL).status == "blind"


def test_the_risk_rises_once_a_dead_end_and_not_at_each_look_around(monkeypatch):
    """It looks to both sides, at two steps each for a mast that is slow, before the next risk level is due."""
    navigator, pan, shares = Navigator(config=SMALL), 0.0, []
    depth = RockWorld().depth(SMALL_RIG, body_pose(0, 0, 0) @ ZHURONG.mount.left_eye(SMALL_RIG.baseline))
    navigator.step(depth, None, SMALL_RIG, body_pose(0, 0, 0), GOAL)
    monkeypatch.setattr(navigator.planner, "plan", lambda *_: None)
    navigator.recovery.attempts = SMALL.risk_after_recoveries
    while (command := navigator.step(depth, None, SMALL_RIG, body_pose(0, 0, 0), GOAL, pan)).status == "look":
        pan += float(np.clip((command.pan or 0.0) - pan, -0.5, 0.5))
        shares.append(navigator.risk.margin_share)
    assert len(shares) >= 4 and set(shares) == {SMALL.risk_levels[0].margin_share}
    assert command.status == "recover" and navigator.recovery.attempts == SMALL.risk_after_recoveries + 1
    while (command := navigator.step(depth, None, SMALL_RIG, body_pose(0, 0, 0), GOAL, pan)).status == "recover":
        pass
    assert command.status == "look" and navigator.risk.margin_share == SMALL.risk_levels[1].margin_share


def wall(height: float, ahead: float = 3.0) -> RockWorld:
    """A row of domes across the way."""
    return RockWorld(domes=np.array([[ahead, y, 0.5, height] for y in np.arange(-4, 4.5, 0.5)]))


@pytest.mark.parametrize(("obstacle_height", "blocked"), [(ZHURONG.obstacle_height, False), (0.12, True)])
def test_what_blocks_is_what_the_rovers_spec_calls_an_obstacle(obstacle_height, blocked):
    navigator = Navigator(replace(ZHURONG, obstacle_height=obstacle_height))
    pose = body_pose(0, 0, 0)
    depth = wall(0.18).depth(SMALL_RIG, pose @ ZHURONG.mount.left_eye(SMALL_RIG.baseline))
    navigator.step(depth, None, SMALL_RIG, pose, GOAL)
    assert navigator.ground.blocked.any() == blocked


def test_settings_follow_the_spec_and_zhurongs_are_the_defaults():
    assert NavigatorConfig.of_rover(ZHURONG) == NavigatorConfig()
    small = NavigatorConfig.of_rover(replace(ZHURONG, obstacle_height=0.15, max_slope=np.deg2rad(10), max_tilt=0.2))
    assert small.traversability.step_blocked == pytest.approx(0.115)
    assert small.elevation.drops.least_drop == pytest.approx(0.15)
    assert small.traversability.roughness_blocked == pytest.approx(0.075)
    assert small.traversability.hiding_width == pytest.approx(0.25)
    assert small.traversability.slope_blocked_deg == pytest.approx(8.8)
    assert small.planner.tilt_limit_deg == pytest.approx(np.rad2deg(0.2) * 25 / 30)
    assert [level.step for level in small.risk_levels] == pytest.approx([0.115, 0.125, 0.1375])
    tiny = NavigatorConfig.of_rover(replace(ZHURONG, obstacle_height=0.02, wheel_radius=ZHURONG.wheel_radius / 8))
    assert tiny.traversability.hiding_width == tiny.elevation.drops.least_gap == pytest.approx(0.2)


@pytest.mark.parametrize("obstacle_height", [0.02, 0.06, 0.3, 0.6])
def test_level_ground_costs_nothing_more_for_any_rover_and_rough_ground_does(obstacle_height):
    config = NavigatorConfig.of_rover(replace(ZHURONG, obstacle_height=obstacle_height)).traversability
    zero, rough = np.zeros((9, 9), np.float32), np.full((9, 9), config.roughness_blocked, np.float32)
    costs = [_ground_cost(zero, zero, roughness, ZHURONG, 0.1, config) for roughness in (zero, rough / 2, rough)]
    assert (costs[0] == 0).all() and (costs[1] > 0.1).all() and costs[2] == pytest.approx(config.roughness_cost)


def test_a_rover_that_cannot_turn_in_place_is_refused():
    with pytest.raises(
        ValueError, match=r"^spec: the navigator turns a rover in place, and this one cannot: .* 45 deg"
    ):
        Navigator(replace(ZHURONG, max_steer=np.deg2rad(45)))


def test_a_wall_that_is_known_before_the_drive_is_driven_round_from_the_start():
    """The wall is farther than depth reaches; the way left of it is closed too."""
    prior = ElevationMap(ElevationConfig(size=60.0))
    x, y = prior.centres()
    behind = (np.abs(x[None, :] - 10.0) < 0.3) & (y[:, None] > -2.0)
    prior.top[:], prior.low[:], prior.weight[:] = np.where(behind, 0.8, 0.0), 0.0, 1.0
    depth = RockWorld().depth(SMALL_RIG, body_pose(0, 0, 0) @ ZHURONG.mount.left_eye(SMALL_RIG.baseline, 0.0))
    depth = np.where(depth > 6.0, np.nan, depth)
    paths = []
    for navigator in (Navigator(), Navigator(prior=prior)):
        for _ in range(2):
            navigator.reset()
            navigator.step(depth, None, SMALL_RIG, body_pose(0, 0, 0), GOAL)
            path = navigator.planner.field.path(np.zeros(3), 18.0)
            paths.append(path[np.abs(path[:, 0] - 10.0) < 0.5, 1])
    assert np.abs(paths[:2]).max() < 0.5 and (paths[2] < -2.5).all() and (paths[3] < -2.5).all()
    with pytest.raises(ValueError, match=r"cells of 0.1 m, got 0.2 m"):
        Navigator(prior=ElevationMap(ElevationConfig(cell=0.2)))


def test_a_look_replaces_what_was_known_before_the_drive():
    prior = ElevationMap()
    prior.top[:], prior.low[:], prior.weight[:] = 0.5, 0.5, 1.0
    navigator = Navigator(prior=prior)
    assert navigator.map.top[200, 240] == 0.5
    depth = RockWorld().depth(SMALL_RIG, body_pose(0, 0, 0) @ ZHURONG.mount.left_eye(SMALL_RIG.baseline, 0.0))
    navigator.step(depth, None, SMALL_RIG, body_pose(0, 0, 0), GOAL)
    assert abs(navigator.map.top[200, 240]) < 0.15 and navigator.map.top[200, 160] == 0.5


@pytest.mark.parametrize("height", [1.2, 0.25])
def test_the_ground_is_known_to_a_rover_with_low_cameras_too(height):
    """Its disparity changes by over 1 px from row to row."""
    spec = replace(ZHURONG, mount=replace(ZHURONG.mount, height=height))
    eye = body_pose(0, 0, 0) @ spec.mount.left_eye(SMALL_RIG.baseline)
    navigator = Navigator(spec)
    navigator.step(RockWorld().depth(SMALL_RIG, eye), None, SMALL_RIG, body_pose(0, 0, 0), np.array([20.0, 0.0]))
    x, y = np.meshgrid(*navigator.map.centres())
    begin = max(0.7 + 1.5 * height, 1.4)
    ahead = (x > begin) & (x < begin + 0.5) & (abs(y) < 0.3)
    assert navigator.map.measured[ahead].all() and ahead.sum() > 20


def test_cells_from_half_a_width_beyond_the_area_are_closed():
    navigator = Navigator(area=(-4.0, -2.0, 9.0, 2.0))
    y = navigator.map.centres()[1]
    assert np.array_equal(navigator._closed()[:, navigator.map.n // 2], np.abs(y) > 2 + ZHURONG.width / 2)


def test_risk_narrows_the_margin_of_the_planner():
    navigator, pose = Navigator(), body_pose(0, 0, 0)
    depth = RockWorld().depth(SMALL_RIG, pose @ ZHURONG.mount.left_eye(SMALL_RIG.baseline))
    navigator.step(depth, None, SMALL_RIG, pose, np.array([8.0, 0.0]))
    navigator.risk.raise_level()
    navigator.step(depth, None, SMALL_RIG, pose, np.array([8.0, 0.0]))
    assert navigator.planner.margin == pytest.approx(0.5 * navigator.config.planner.margin)


def test_hemmed_in_is_where_the_rover_stands():
    navigator = Navigator()
    inflated = np.zeros((navigator.map.n,) * 2, bool)
    x, y = navigator.map.cell_of(np.array([3.0, -2.0]))
    inflated[y, x] = True
    ground = SimpleNamespace(inflated=inflated)
    assert navigator._is_hemmed_in(np.array([3.0, -2.0, 0.0]), ground)
    assert not navigator._is_hemmed_in(np.array([-2.0, 3.0, 0.0]), ground)


def test_dead_ends_cost_within_a_metre_of_each():
    navigator, place = Navigator(), np.zeros(3)
    before = navigator.judge(place).cost
    navigator.recovery.dead_ends = [np.array([5.0, 0.0]), np.array([-2.0, 6.0])]
    x, y = np.meshgrid(*navigator.map.centres())
    away, more = np.minimum(np.hypot(x - 5, y), np.hypot(x + 2, y - 6)), navigator.judge(place).cost - before
    np.testing.assert_allclose(more[away < 0.9], 3.0, atol=1e-5)
    assert (more[away > 1.1] == 0).all()


@pytest.mark.parametrize("left", [0.05, 0.15, 0.18, 5.0])
def test_near_the_goal_a_step_ends_at_the_goal_radius_or_a_little_beyond(left):
    navigator, here = Navigator(), np.zeros(3)
    config = navigator.config
    arc = Motion(0.0, 0.0, 4.0, 4.0, arc_poses(here, np.zeros(1), np.linspace(0.0, 4.0, 41))[0])
    step = navigator._follow(arc, here, config.goal_radius + left, 0.0).speed * config.step_time
    assert step == pytest.approx(min(max(left, 0.1), ZHURONG.max_speed * config.step_time))
