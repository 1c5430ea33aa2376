from dataclasses import replace

import numpy as np
import pytest
from flat_map import scene
from hypothesis import given
from hypothesis import strategies as st

from marssim.base.rover_spec import ZHURONG
from nav.path.footprint import arc_poses
from nav.path.planner import Planner, PlannerConfig, free_length, room_needed

CONFIG = PlannerConfig()


def plan(elevation, ground, goal, pose=(0.0, 0.0, 0.0)):
    planner = Planner(ZHURONG, CONFIG, elevation)
    goal = np.asarray(goal, float)
    planner.update(elevation, ground, goal)
    return planner.plan(elevation, ground, np.asarray(pose, float), goal)


@given(st.floats(-0.5, 2.0), st.floats(0.0, 0.3))
def test_a_rover_within_the_margin_may_come_nearer_by_little_and_never_into_the_rock(room, margin):
    least = room_needed(np.array(room), margin)
    assert least <= margin and least <= max(room, margin)
    if room < margin:
        assert room - least <= 0.01 + 1e-9
    plans = [room]
    for _ in range(200):
        plans.append(min(plans[-1], float(room_needed(np.array(plans[-1]), margin))))
    assert plans[-1] == pytest.approx(min(room, -0.05)) or room >= margin


@pytest.mark.parametrize("side", [-0.6, 0.0, 0.6])
def test_arcs_through_rocks_are_rejected(side):
    elevation, ground = scene([(3.0, side, 0.25)])
    poses = arc_poses(np.zeros(3), np.zeros(1), np.arange(0, 4.01, 0.2))
    free = free_length(poses, 0.2, elevation, ground, ZHURONG, CONFIG)[0]
    # The front wheels stand 0.8 m ahead of the centre, the rock begins at 2.75 m.
    assert 1.4 <= free <= 2.75 - 0.8


def test_wide_gaps_pass_and_narrow_ones_do_not():
    for gap, passes in ((1.3, False), (2.2, True)):
        elevation, ground = scene([(3.0, gap / 2 + 0.3, 0.3), (3.0, -gap / 2 - 0.3, 0.3)])
        poses = arc_poses(np.zeros(3), np.zeros(1), np.arange(0, 4.01, 0.2))
        assert (free_length(poses, 0.2, elevation, ground, ZHURONG, CONFIG)[0] >= 3.8) == passes


def test_unseen_ground_ends_an_arc():
    elevation, ground = scene(seen=lambda x, y: x < 3.0)
    poses = arc_poses(np.zeros(3), np.zeros(1), np.arange(0, 4.01, 0.2))
    assert free_length(poses, 0.2, elevation, ground, ZHURONG, CONFIG)[0] <= 2.2


def test_a_rover_beside_a_rock_may_leave_but_not_come_nearer():
    elevation, ground = scene([(1.1, 0.0, 0.25)])
    ahead = arc_poses(np.zeros(3), np.zeros(1), np.arange(0, 2.01, 0.2))
    back = arc_poses(np.zeros(3), np.zeros(1), -np.arange(0, 2.01, 0.2))
    assert free_length(ahead, 0.2, elevation, ground, ZHURONG, CONFIG)[0] == 0
    assert free_length(back, 0.2, elevation, ground, ZHURONG, CONFIG)[0] == pytest.approx(2.0)


def test_open_ground_is_driven_straight():
    motion = plan(*scene(), goal=(7.0, 0.0))
    assert motion.turn == 0 and abs(motion.curvature) < 0.05


@pytest.mark.parametrize("side", [1, -1])
def test_the_goal_beside_is_turned_to_the_short_way(side):
    motion = plan(*scene(), goal=(-3.0, 5.0 * side))
    assert np.sign(motion.turn or motion.curvature) == side


def test_a_goal_behind_is_turned_to_in_place():
    assert abs(plan(*scene(), goal=(-6.0, 0.1)).turn) > np.deg2rad(90)


def test_what_was_not_seen_beside_the_rover_is_turned_over_only_where_nothing_else_leads_on():
    def seen(x, y):
        return (np.abs(y) < 0.8) | (np.abs(x) > 1.2) | (np.abs(y) > 2.0)

    behind = (-6.0, 0.1)
    assert plan(*scene(seen=seen), goal=behind).turn == 0  # a curve ahead first
    walled = [(1.6, y, 0.25) for y in np.arange(-6, 6.1, 0.4)]
    assert abs(plan(*scene(walled, seen), goal=behind).turn) > np.deg2rad(90)


def test_turning_to_and_fro_comes_to_an_end():
    """Two headings, each of which takes the other's way for the better one: a goal that moves stands for them here."""
    elevation, ground = scene([(1.6, y, 0.25) for y in np.arange(-6, 6.1, 0.4)])  # no driving on
    planner = Planner(ZHURONG, CONFIG, elevation)
    sides = []
    for n in range(12):
        goal = np.array([-3.0, 6.0 * (-1) ** n])
        planner.update(elevation, ground, goal)
        sides.append(np.sign(planner.plan(elevation, ground, np.zeros(3), goal).turn))
    changes = np.flatnonzero(np.diff(sides))
    assert 1 <= len(changes) <= 6 and changes[-1] < 8 and sides[-1] != 0


def chosen(goal, cost=0.0, before=0.0, **changes):
    """The motion to a goal on open ground, each metre of which costs so much more, after a drive of a curvature."""
    elevation, ground = scene()
    ground = replace(ground, cost=np.full_like(ground.cost, cost))
    planner = Planner(ZHURONG, replace(CONFIG, **changes), elevation)
    planner.previous_curvature = before
    planner.update(elevation, ground, np.array(goal))
    return planner.plan(elevation, ground, np.zeros(3), np.array(goal))


def test_a_motion_costs_what_the_ground_on_the_whole_way_does():
    for cost in (0.0, 1.5):
        motion = chosen((7.0, 0.05), cost)
        assert motion.turn == 0 and abs(motion.curvature) < 0.05
        assert motion.cost == pytest.approx(7.0 * (1 + cost), rel=0.03)


def test_departing_from_the_last_curvature_costs():
    assert chosen((7.0, 0.05), before=0.5).cost > chosen((7.0, 0.05)).cost
    steady, torn = (chosen((7.0, 0.05), before=0.5, change_cost=cost, turn_start_cost=1000.0) for cost in (0.0, 20.0))
    assert abs(steady.curvature) < 0.05 and torn.curvature == pytest.approx(0.5, abs=0.1)


def test_bends_cost_and_end_in_time():
    goal, no_turns = (-3.0, 4.0), {"turn_start_cost": 100.0}
    bent = chosen(goal, **no_turns)
    assert bent.turn == 0 and np.deg2rad(90) < bent.curvature * bent.length <= np.deg2rad(CONFIG.max_turn_deg) + 1e-6
    farther = chosen(goal, **no_turns, max_turn_deg=200.0)
    assert farther.curvature * farther.length > np.deg2rad(CONFIG.max_turn_deg) + 0.1
    assert chosen(goal, **no_turns, bend_cost=20.0).curvature < 0.7 * bent.curvature


def test_rocks_are_driven_round():
    elevation, ground = scene([(3.5, 0.1, 0.4)])
    motion = plan(elevation, ground, (7.0, 0.0))
    assert motion.curvature < 0 or motion.turn < 0
    assert free_length(motion.poses[None], 0.2, elevation, ground, ZHURONG, CONFIG)[0] >= motion.length - 1e-9


def test_walled_in_there_is_no_motion():
    ring = [(1.6 * np.cos(a), 1.6 * np.sin(a), 0.25) for a in np.linspace(0, 2 * np.pi, 24)]
    assert plan(*scene(ring), goal=(7.0, 0.0)) is None
