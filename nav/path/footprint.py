"""The ground that the rover covers along a motion, and its distance to the cells that a map marks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from marssim.base.rover_spec import RoverSpec
from nav.ground.elevation import ElevationMap

DISCS_ALONG, DISCS_ACROSS = 5, 4  # number of discs that cover the footprint


def footprint_corners(spec: RoverSpec, pose: Sequence[float]) -> np.ndarray:
    """Return the corners of the footprint rectangle from above, front left first, clockwise.

    Args:
        spec: The rover.
        pose: x, y [m], yaw [rad].

    Returns:
        (4, 2) world positions [m].
    """
    x, y, yaw = pose
    ahead = np.array([1, 1, -1, -1]) * spec.length / 2
    left = np.array([1, -1, -1, 1]) * spec.width / 2
    c, s = np.cos(yaw), np.sin(yaw)
    return np.stack([x + c * ahead - s * left, y + s * ahead + c * left], axis=-1)


def footprint_discs(spec: RoverSpec) -> tuple[np.ndarray, float]:
    """Return discs that cover the footprint rectangle.

    Returns:
        The centres (20, 2) in the body frame and the radius [m]. For Zhurong the cover is 6 cm wider and 8 cm longer on
        each side than the rectangle.
    """
    nx, ny = DISCS_ALONG, DISCS_ACROSS
    x = ((np.arange(nx) + 0.5) / nx - 0.5) * spec.length
    y = ((np.arange(ny) + 0.5) / ny - 0.5) * spec.width
    centres = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    return centres, float(np.hypot(spec.length / nx, spec.width / ny) / 2)


def footprint_distance(field: np.ndarray, elevation: ElevationMap, poses: np.ndarray, spec: RoverSpec) -> np.ndarray:
    """Return the distance between the footprint and the cells that a distance map measures to.

    Args:
        field: (n, n) distance map over the cells of the elevation map [m].
        elevation: The map.
        poses: (..., 3) x, y [m], yaw [rad].
        spec: The rover.

    Returns:
        (...) distance [m]; negative where they overlap, -inf off the map.
    """
    centres, radius = footprint_discs(spec)
    return sampled(field, elevation, poses, centres, -np.inf).min(axis=-1) - radius


def sampled(
    values: np.ndarray, elevation: ElevationMap, poses: np.ndarray, points: np.ndarray, outside: float
) -> np.ndarray:
    """Return the values of the cells under points of the rover.

    Args:
        values: (n, n) values of the cells of the elevation map.
        elevation: The map.
        poses: (..., 3) x, y [m], yaw [rad].
        points: (k, 2) metres ahead and to the left of the body's origin.
        outside: The value off the map.

    Returns:
        (..., k) values.
    """
    cos, sin = np.cos(poses[..., 2, None]), np.sin(poses[..., 2, None])
    x = poses[..., 0, None] + cos * points[:, 0] - sin * points[:, 1]
    y = poses[..., 1, None] + sin * points[:, 0] + cos * points[:, 1]
    cell = elevation.cell_of(np.stack([x, y], axis=-1))
    n = elevation.n
    inside = ((cell >= 0) & (cell < n)).all(axis=-1)
    cell = np.clip(cell, 0, n - 1)
    return np.where(inside, values[cell[..., 1], cell[..., 0]], outside)


def arc_poses(start: np.ndarray, curvature: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """Return poses along arcs of constant curvature.

    Args:
        start: (..., 3) x, y [m], yaw [rad].
        curvature: (...) [1/m], positive to the left.
        distance: (k,) distances along the arc [m], negative backwards.

    Returns:
        (..., k, 3) x, y [m], yaw [rad].
    """
    start = np.asarray(start, float)[..., None, :]
    curvature = np.asarray(curvature, float)[..., None]
    angle = curvature * distance
    # Chord of an arc: s sinc(angle / 2), in the direction halfway between both headings.
    chord = distance * np.sinc(angle / (2 * np.pi))
    middle = start[..., 2] + angle / 2
    return np.stack(
        [start[..., 0] + chord * np.cos(middle), start[..., 1] + chord * np.sin(middle), start[..., 2] + angle], axis=-1
    )


def turn_poses(start: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """Return the poses after turns in place.

    Args:
        start: (3,) x, y [m], yaw [rad].
        turns: (...) heading changes [rad], positive to the left.

    Returns:
        (..., 3) x, y [m], yaw [rad].
    """
    return np.stack([np.full(turns.shape, start[0]), np.full(turns.shape, start[1]), start[2] + turns], axis=-1)
