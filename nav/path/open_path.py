"""Whether a path to the goal is open on a map, from where the rover stands."""

from __future__ import annotations

import numpy as np

from nav.ground.elevation import ElevationMap
from nav.ground.traversability import Traversability
from nav.path.distance_field import DistanceField
from nav.path.planner import Planner

PATH_END = 1.0  # [m] from either end of the far path, within which an obstacle does not close it


def is_closed(field: DistanceField, place: np.ndarray, goal: np.ndarray) -> bool:
    """Return whether even the best path to the goal leads through known obstacles, away from both of its ends.

    Args:
        field: The cost to go to the goal.
        place: (3,) x, y [m], yaw [rad] of the rover.
        goal: (2,) goal in the world [m].
    """
    path = field.path(place, 2 * field.m * field.cell)
    from_ends = np.minimum(np.hypot(*(path - place[:2]).T), np.hypot(*(path - goal).T))
    return bool((field.is_inflated(path) & (from_ends > PATH_END)).any())


def is_open(
    planner: Planner, elevation: ElevationMap, ground: Traversability, place: np.ndarray, goal: np.ndarray
) -> bool:
    """Return whether no known obstacle closes the best path to the goal, and the best motion begins such a path.

    It does so if it ends where the cost to go is lower. Otherwise it leads back or aside, as where the ground ahead is
    unknown.

    Args:
        planner: A planner for maps of this size; it forgets its last motion, and takes in this map.
        elevation: The map.
        ground: The judged ground.
        place: (3,) x, y [m], yaw [rad] of the rover.
        goal: (2,) goal in the world [m].
    """
    planner.reset()
    planner.update(elevation, ground, goal)
    if is_closed(planner.field, place, goal):
        return False
    motion = planner.plan(elevation, ground, place, goal)
    if motion is None or planner.considered is None:
        return False
    end = planner.considered.end[planner.considered.cost.argmin()]  # where the next motion would begin
    left = motion.poses[round(end / planner.config.spacing), :2]
    return bool(planner.field.at(left) < planner.field.at(place[:2]))
