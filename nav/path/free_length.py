"""How far a motion is free: of obstacles, of unseen ground, of steep ground and of things under the belly."""

from __future__ import annotations

import numpy as np

from marssim.base.rover_spec import RoverSpec
from nav.ground.elevation import ElevationMap
from nav.ground.traversability import Traversability
from nav.path.footprint import footprint_distance
from nav.path.planner_config import PlannerConfig
from nav.path.stance import StanceModel

REPLANNED = 0.01  # [m] by which a rover within a margin may come nearer from one plan to the next
REPLANNED_TILT = 0.02  # [rad] by which a rover beyond the tilt limit may tilt more from one plan to the next


def room_needed(room: np.ndarray, margin: float, cell: float) -> np.ndarray:
    """Return how near to an obstacle a motion may come.

    That is the margin. A rover that already stands within the margin may come nearer by REPLANNED, or it would be
    stuck; this adds up over the plans, but ends where footprint and obstacle overlap by half a cell of the
    map, by which the obstacle's edge may be wrong.

    Args:
        room: (...) distance from the rover to the obstacle now [m].
        margin: The margin [m].
        cell: Edge of a cell of the map [m].

    Returns:
        (...) least distance [m].
    """
    return np.minimum(margin, np.maximum(room - REPLANNED, np.minimum(room, -cell / 2)))


def free_length(
    poses: np.ndarray,
    spacing: float,
    elevation: ElevationMap,
    ground: Traversability,
    spec: RoverSpec,
    config: PlannerConfig,
    stance: StanceModel | None = None,
    margin: float | None = None,
) -> np.ndarray:
    """Return how far motions are free: no obstacles, no unseen ground, level enough, and room under the belly.

    A rover that already stands within a margin may move as long as it comes no nearer.

    Args:
        poses: (a, k, 3) poses x, y [m], yaw [rad] of a motions, the first where the rover stands.
        spacing: Distance between two poses [m].
        elevation: The map.
        ground: The judged ground.
        spec: The rover.
        config: The limits.
        stance: The surface under wheels and belly; None checks neither tilt nor belly.
        margin: Distance to obstacles [m], instead of that of config.

    Returns:
        (a,) free lengths [m].
    """
    room = footprint_distance(ground.clearance, elevation, poses, spec)
    dark_room = footprint_distance(ground.dark_distance, elevation, poses, spec)
    ok = room >= room_needed(room[:, :1], config.margin if margin is None else margin, elevation.config.cell)
    ok &= dark_room >= np.minimum(config.dark_margin, dark_room[:, :1] - REPLANNED)
    if stance is not None:
        place = stance.at(poses)
        ok &= place.tilt <= np.maximum(np.deg2rad(config.tilt_limit_deg), place.tilt[:, :1] + REPLANNED_TILT)
        ok &= place.clearance >= np.minimum(config.belly_margin, place.clearance[:, :1] - REPLANNED)
    ok[:, 0] = True
    return (np.cumprod(ok, axis=1).sum(axis=1) - 1) * spacing
