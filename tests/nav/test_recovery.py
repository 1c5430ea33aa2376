from dataclasses import replace

import numpy as np
import pytest
from drawn_maps import flat_map_with_rocks

from marssim.base.rover_spec import ZHURONG
from nav.command import Command
from nav.config import NavigatorConfig
from nav.path.footprint import arc_poses
from nav.path.planner import Planner
from nav.recovery import Recovery

CONFIG = NavigatorConfig()
SIDE = np.deg2rad(CONFIG.look_pan_deg)
ORIGIN = np.zeros(3)


@pytest.fixture
def recovery_on_flat_ground():
    """Makes a recovery that came to the origin along the x axis, and what it is asked with on a map with rocks."""

    def make(*rocks, came_from=-4.0):
        elevation, ground = flat_map_with_rocks(rocks)
        planner = Planner(ZHURONG, CONFIG.planner, elevation)
        planner.update(elevation, ground, np.array([7.0, 0.0]))
        recovery = Recovery(ZHURONG, CONFIG)
        for x in np.arange(came_from, 0.01, 0.4):
            recovery.follow(np.array([x, 0.0, 0.0]))
        return recovery, (ground, elevation, planner)

    return make


def test_the_mast_looks_to_both_sides_before_the_rover_backs_out(recovery_on_flat_ground):
    recovery, about = recovery_on_flat_ground()
    wishes, pan = [], 0.0
    for _ in range(3):
        command = recovery.search(ORIGIN, *about, pan, True)
        wishes.append((command.status, command.pan))
        pan = command.pan or 0.0
    assert wishes[:2] == [("look", pytest.approx(SIDE)), ("look", pytest.approx(-SIDE))]
    assert command.status == "recover" and recovery.backing and recovery.attempts == 1


def test_the_search_asks_for_no_pan_that_the_mast_cannot_reach():
    elevation, ground = flat_map_with_rocks()
    spec = replace(ZHURONG, mount=replace(ZHURONG.mount, pan_limit=0.4))
    planner = Planner(spec, CONFIG.planner, elevation)
    planner.update(elevation, ground, np.array([7.0, 0.0]))
    command = Recovery(spec, CONFIG).search(ORIGIN, ground, elevation, planner, 0.0, True)
    assert command == Command(0.0, 0.0, 0.4, "look")


def test_the_search_waits_for_a_slow_mast_and_uses_no_mast_that_does_not_turn(recovery_on_flat_ground):
    recovery, about = recovery_on_flat_ground()
    for pan in (0.0, 0.2, 0.4):  # 0.7 rad are wished for
        assert recovery.search(ORIGIN, *about, pan, True).pan == pytest.approx(SIDE)
    assert recovery.search(ORIGIN, *about, 0.7, True).pan == pytest.approx(-SIDE)
    recovery, about = recovery_on_flat_ground()
    assert recovery.search(ORIGIN, *about, 0.0, False).status == "recover"


def test_the_rover_backs_out_along_its_track_by_the_set_distance(recovery_on_flat_ground):
    recovery, about = recovery_on_flat_ground()
    command, here, steps = recovery.search(ORIGIN, *about, 0.0, False), ORIGIN, 0
    while command is not None:
        assert command.speed < 0 and steps < 20
        distance = command.speed * CONFIG.step_time
        here = arc_poses(here, np.array(command.yaw_rate / command.speed), np.array([distance]))[0]
        recovery.count(here, -distance, command)
        command, steps = recovery.back_up(here, *about), steps + 1
    assert -CONFIG.back_up - 0.31 < here[0] <= -CONFIG.back_up + 1e-6 and abs(here[1]) < 0.05
    assert not recovery.backing


def test_the_rover_turns_where_a_rock_stands_behind_it(recovery_on_flat_ground):
    recovery, about = recovery_on_flat_ground((-1.45, 0.0, 0.2))  # half a metre behind the rear wheels, clear of a turn
    command = recovery.search(ORIGIN, *about, 0.0, False)
    assert command.status == "recover" and command.speed == 0 and command.yaw_rate != 0 and not recovery.backing


def test_a_rover_hemmed_in_all_round_stands_still(recovery_on_flat_ground):
    corners = [(x, y, 0.08) for x in (0.55, -0.55) for y in (0.95, -0.95)]  # beside the flanks, where corners turn
    recovery, about = recovery_on_flat_ground((-1.2, 0.0, 0.2), *corners)
    assert recovery.search(ORIGIN, *about, 0.0, False) == Command(0.0, 0.0, None, "look")


def test_backing_that_does_not_move_ends(recovery_on_flat_ground):
    recovery, about = recovery_on_flat_ground()
    command = recovery.search(ORIGIN, *about, 0.0, False)
    recovery.count(ORIGIN, 0.0, command)
    assert not recovery.backing and recovery.back_up(ORIGIN, *about) is None


def test_a_rover_whose_wheels_can_only_turn_in_place_there_ends_its_backing():
    spec = replace(ZHURONG, wheel_x=(0.6, 0.0, -0.6), max_steer=np.pi / 4)
    elevation, ground = flat_map_with_rocks()
    planner = Planner(spec, CONFIG.planner, elevation)
    planner.update(elevation, ground, np.array([7.0, 0.0]))
    recovery = Recovery(spec, CONFIG)
    recovery.follow(np.array([-0.3, 0.5, 0.0]))
    recovery.start(ORIGIN)
    assert recovery.back_up(ORIGIN, ground, elevation, planner) is None and not recovery.backing


def test_the_search_ends_after_max_recoveries(recovery_on_flat_ground):
    recovery, about = recovery_on_flat_ground()
    for _ in range(CONFIG.max_recoveries):
        assert recovery.search(ORIGIN, *about, 0.0, False) is not None
    assert recovery.search(ORIGIN, *about, 0.0, False) is None


def test_a_bump_is_remembered_before_the_rover_and_backed_from(recovery_on_flat_ground):
    recovery, _ = recovery_on_flat_ground()
    recovery.bump(np.array([1.0, 2.0, np.pi / 2]))
    np.testing.assert_allclose(recovery.bumps, [[1.0, 2.0 + ZHURONG.length / 2 + 0.15]], atol=1e-9)
    np.testing.assert_allclose(recovery.dead_ends, [[1.0, 2.5]], atol=1e-9)
    assert recovery.backing and recovery.attempts == 1


def test_a_slow_rover_backs_out_on_the_same_curve():
    elevation, ground = flat_map_with_rocks()
    track = [np.array([2 * np.sin(a), 2 - 2 * np.cos(a), a]) for a in np.linspace(-1.0, 0.0, 12)]  # a left curve
    curvatures = []
    for max_speed in (0.2, 0.05):
        spec = replace(ZHURONG, max_speed=max_speed)
        planner = Planner(spec, CONFIG.planner, elevation)
        planner.update(elevation, ground, np.array([7.0, 0.0]))
        recovery = Recovery(spec, CONFIG)
        for place in track:
            recovery.follow(place)
        command = Command(0.0, 0.0, None, "look")
        for _ in range(9):
            if (command := recovery.search(ORIGIN, ground, elevation, planner, 0.0, False)).speed < 0:
                break
        assert -command.speed == pytest.approx(min(CONFIG.back_speed, max_speed))
        curvatures.append(command.yaw_rate / command.speed)
    assert curvatures[0] == pytest.approx(curvatures[1]) == pytest.approx(0.5, abs=0.1)


def test_where_it_cannot_go_back_it_turns_as_far_as_there_is_room():
    elevation, ground = flat_map_with_rocks([(-1.45, 0.0, 0.2)])  # on the way back
    planner = Planner(ZHURONG, CONFIG.planner, elevation)
    planner.update(elevation, ground, np.array([7.0, 0.0]))
    recovery = Recovery(ZHURONG, CONFIG)
    for x in (-2.0, -1.5, -1.0, -0.5, 0.0):
        recovery.follow(np.array([x, 0.0, 0.0]))
    command = recovery.search(ORIGIN, ground, elevation, planner, 0.0, False)
    assert command.speed == 0 and abs(command.yaw_rate) == pytest.approx(ZHURONG.max_yaw_rate)
