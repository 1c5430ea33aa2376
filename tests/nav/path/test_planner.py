from dataclasses import replace

import numpy as np
import pytest
from drawn_maps import flat_map_with_rocks

from marssim.base.rover_spec import ZHURONG
from nav.path.free_length import free_length
from nav.path.planner import Planner
from nav.path.planner_config import PlannerConfig

CONFIG = PlannerConfig()


def plan(elevation, ground, goal, pose=(0.0, 0.0, 0.0)):
    planner = Planner(ZHURONG, CONFIG, elevation)
    goal = np.asarray(goal, float)
    planner.update(elevation, ground, goal)
    return planner.plan(elevation, ground, np.asarray(pose, float), goal)


def test_open_ground_is_driven_straight():
    motion = plan(*flat_map_with_rocks(), goal=(7.0, 0.0))
    assert motion.turn == 0 and abs(motion.curvature) < 0.05


@pytest.mark.parametrize("side", [1, -1])
def test_the_goal_beside_is_turned_to_the_short_way(side):
    motion = plan(*flat_map_with_rocks(), goal=(-3.0, 5.0 * side))
    assert np.sign(motion.turn or motion.curvature) == side


def test_a_goal_behind_is_turned_to_in_place():
    assert abs(plan(*flat_map_with_rocks(), goal=(-6.0, 0.1)).turn) > np.deg2rad(90)


def test_what_was_not_seen_beside_the_rover_is_turned_over_only_where_nothing_else_leads_on():
    def seen(x, y):
        return (np.abs(y) < 0.8) | (np.abs(x) > 1.2) | (np.abs(y) > 2.0)

    behind = (-6.0, 0.1)
    assert plan(*flat_map_with_rocks(seen=seen), goal=behind).turn == 0  # a curve ahead first
    walled = [(1.6, y, 0.25) for y in np.arange(-6, 6.1, 0.4)]
    assert abs(plan(*flat_map_with_rocks(walled, seen), goal=behind).turn) > np.deg2rad(90)


def test_turning_to_and_fro_comes_to_an_end():
    """Two headings, each of which takes the other's way for the better one: a goal that moves stands for them here."""
    elevation, ground = flat_map_with_rocks([(1.6, y, 0.25) for y in np.arange(-6, 6.1, 0.4)])  # no driving on
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
    elevation, ground = flat_map_with_rocks()
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


@pytest.mark.parametrize(("axis", "dear"), [("x", 5.0), ("y", 0.0)])
def test_a_motion_costs_what_the_ground_under_it_does(axis, dear):
    """Ground beyond 0.4 m along an axis costs 5 a metre: the way straight on, along x, meets it or runs beside it."""
    elevation, ground = flat_map_with_rocks()
    at = dict(zip("xy", np.meshgrid(*elevation.centres()), strict=True))
    ground = replace(ground, cost=np.where(at[axis] > 0.4, np.float32(5), np.float32(0)))
    planner, goal = Planner(ZHURONG, CONFIG, elevation), np.array([7.0, 0.0])
    planner.update(elevation, ground, goal)
    planner.plan(elevation, ground, np.zeros(3), goal)
    compared = planner.considered
    straight = np.argmin(np.abs(compared.curvature) + np.abs(compared.turn))
    cost, end = compared.parts["ground"][straight], compared.end[straight]
    assert end > 1 and cost == pytest.approx(dear * (end - 0.4), abs=0.2 * dear + 1e-4)


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
    elevation, ground = flat_map_with_rocks([(3.5, 0.1, 0.4)])
    motion = plan(elevation, ground, (7.0, 0.0))
    assert motion.curvature < 0 or motion.turn < 0
    assert free_length(motion.poses[None], 0.2, elevation, ground, ZHURONG, CONFIG)[0] >= motion.length - 1e-9


def test_walled_in_there_is_no_motion():
    ring = [(1.6 * np.cos(a), 1.6 * np.sin(a), 0.25) for a in np.linspace(0, 2 * np.pi, 24)]
    assert plan(*flat_map_with_rocks(ring), goal=(7.0, 0.0)) is None


def test_a_plan_keeps_all_that_it_compared_with_the_parts_of_their_costs():
    elevation, ground = flat_map_with_rocks([(2.0, y, 0.3) for y in np.arange(-1.0, 0.6, 0.4)])
    goal, planner = np.array([7.0, 0.3]), Planner(ZHURONG, CONFIG, elevation)
    planner.previous_curvature = 0.2
    planner.update(elevation, ground, goal)
    motion, compared = planner.plan(elevation, ground, np.zeros(3), goal), planner.considered
    free = np.isfinite(compared.cost)
    assert (compared.turn == 0).sum() == CONFIG.arcs and 0 < free.sum() < free.size  # the rocks close some
    np.testing.assert_allclose(sum(compared.parts.values())[free], compared.cost[free])
    best = compared.cost.argmin()
    chosen = compared.curvature[best], compared.turn[best], compared.free[best], compared.cost[best]
    assert chosen == (motion.curvature, motion.turn, motion.length, motion.cost)
    assert (compared.end[free] <= CONFIG.lookahead + 1e-6).all() and (compared.parts["way"] == compared.end).all()
    arcs = compared.turn == 0
    assert (compared.parts["turn"][arcs] == 0).all() and (compared.parts["turn"][~arcs] > 0).all()
    bend = CONFIG.bend_cost * abs(compared.curvature * compared.end)
    np.testing.assert_allclose(compared.parts["bend"][arcs], bend[arcs])
    np.testing.assert_allclose(compared.parts["change"][arcs], CONFIG.change_cost * abs(compared.curvature - 0.2)[arcs])


def test_a_turn_ends_before_the_rock_that_a_corner_would_sweep_over():
    elevation, ground = flat_map_with_rocks([(0.55, 0.95, 0.08)])
    turns = Planner(ZHURONG, CONFIG, elevation).free_turns(elevation, ground, np.zeros(3))
    for side in (1, -1):
        free = np.sort(side * turns[side * turns > 0])
        assert free == pytest.approx(2 * np.pi / CONFIG.turns * np.arange(1, len(free) + 1)) and len(free) < 12
    assert len(turns)
