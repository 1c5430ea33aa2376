import numpy as np
import pytest
from drawn_maps import flat_map_with_rocks
from rock_world import SMALL_RIG, RockWorld, body_pose

from marssim.base.rover_spec import ZHURONG
from nav.ground.elevation import ElevationMap
from nav.ground.traversability import TraversabilityConfig, assess
from nav.path.open_path import is_closed, is_open
from nav.path.planner import Planner
from nav.path.planner_config import PlannerConfig

PLACE, GOAL = np.zeros(3), np.array([8.0, 0.0])


def seen(world, farthest=np.inf):
    """Return the map of three looks from the origin; farthest: range beyond which depth is unknown [m]."""
    elevation = ElevationMap()
    elevation.assume_flat(body_pose(*PLACE), 1.5)
    for pan in (0.7, -0.7, 0.0):
        eye = body_pose(*PLACE) @ ZHURONG.mount.left_eye(SMALL_RIG.baseline, pan)
        depth = world.depth(SMALL_RIG, eye)
        elevation.integrate(np.where(depth > farthest, np.nan, depth), None, SMALL_RIG, eye)
    return elevation


@pytest.mark.parametrize("half_width", [0.5, 30.0])
def test_a_wall_closes_the_path_if_none_leads_round_it(half_width):
    """Ground farther than 3 m to either side is closed, so that a wall from border to border leaves none."""
    elevation = seen(RockWorld(boxes=np.array([[4.0, 0.0, 0.3, half_width, 0.6]])))
    outside = np.repeat(np.abs(elevation.centres()[1])[:, None] > 3, elevation.n, axis=1)
    ground = assess(elevation, ZHURONG, TraversabilityConfig(), outside)
    planner = Planner(ZHURONG, PlannerConfig(), elevation)
    assert is_open(planner, elevation, ground, PLACE, GOAL) is (half_width == 0.5)
    assert is_closed(planner.field, PLACE, GOAL) is (half_width == 30.0)


def test_no_path_is_open_where_the_ground_ahead_is_unknown():
    elevation = seen(RockWorld(), farthest=0.0)
    planner = Planner(ZHURONG, PlannerConfig(), elevation)
    ground = assess(elevation, ZHURONG, TraversabilityConfig())
    assert not is_open(planner, elevation, ground, PLACE, GOAL)
    planner.update(elevation, ground, GOAL)
    assert not is_closed(planner.field, PLACE, GOAL)  # no known obstacle closes it


@pytest.mark.parametrize(("seen_to", "leads_on"), [(2.0, True), (1.0, False)])
def test_a_motion_away_from_the_goal_begins_no_open_path(seen_to, leads_on):
    """Beyond seen_to the ground is unknown: where it lies at the wheels, the rover turns aside and drives there."""
    elevation, ground = flat_map_with_rocks(seen=lambda x, y: x < seen_to)
    planner = Planner(ZHURONG, PlannerConfig(), elevation)
    goal = np.array([7.0, 0.0])
    assert is_open(planner, elevation, ground, PLACE, goal) is leads_on
    motion = planner.plan(elevation, ground, PLACE, goal)
    assert (np.hypot(*(motion.poses[-1, :2] - goal)) < 7.0) == leads_on and not is_closed(planner.field, PLACE, goal)


@pytest.mark.parametrize(("x", "closes"), [(8.0, False), (6.0, True)])
def test_an_obstacle_at_the_end_of_a_path_does_not_close_it(x, closes):
    """It may be what the rover drives to; the goal lies within its margin."""
    elevation = ElevationMap()
    elevation.assume_flat(body_pose(*PLACE), 15.0)
    outside = np.repeat(np.abs(elevation.centres()[1])[:, None] > 1.2, elevation.n, axis=1)
    rock = np.hypot(elevation.centres()[0][None, :] - x, elevation.centres()[1][:, None]) < 0.3
    ground = assess(elevation, ZHURONG, TraversabilityConfig(), outside | rock)
    planner = Planner(ZHURONG, PlannerConfig(), elevation)
    planner.update(elevation, ground, GOAL)
    assert planner.field.is_inflated(np.array([[x, 0.0]])).all()
    assert is_closed(planner.field, PLACE, GOAL) is closes
