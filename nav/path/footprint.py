"""The ground that the rover covers along a motion, and how far that is from what a map marks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from marssim.base.rover_spec import RoverSpec
from nav.ground.elevation import ElevationMap

DISCS_ALONG, DISCS_ACROSS = 5, 4  # that cover the footprint


def footprint_corners(spec: RoverSpec, pose: Sequence[float]) -> np.ndarray:
    """(4, 2) [m] corners of the footprint rectangle seen from above, front left first, clockwise. pose: x, y, yaw."""
    x, y, yaw = pose
    ahead = np.array([1, 1, -1, -1]) * spec.length / 2
    left = np.array([1, -1, -1, 1]) * spec.width / 2
    c, s = np.cos(yaw), np.sin(yaw)
    return np.stack([x + c * ahead - s * left, y + s * ahead + c * left], axis=-1)


def footprint_discs(spec: RoverSpec) -> tuple[np.ndarray, float]:
    """Discs that cover the footprint rectangle.

    Returns their centres (20, 2) in the body frame and their radius [m]; for Zhurong the cover is 6 cm wider and 8 cm
    longer on each side than the rectangle.
    """
    nx, ny = DISCS_ALONG, DISCS_ACROSS
    x = ((np.arange(nx) + 0.5) / nx - 0.5) * spec.length
    y = ((np.arange(ny) + 0.5) / ny - 0.5) * spec.width
    centres = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    return centres, float(np.hypot(spec.length / nx, spec.width / ny) / 2)


def footprint_distance(field: np.ndarray, elevation: ElevationMap, poses: np.ndarray, spec: RoverSpec) -> np.ndarray:
    """Distance [m] between the footprint and what a distance map measures to; negative where they overlap.

    field: (n, n) [m] over the map's cells; poses: (..., 3) x, y, yaw. Returns (...); -inf off the map.
    """
    centres, radius = footprint_discs(spec)
    cos, sin = np.cos(poses[..., 2, None]), np.sin(poses[..., 2, None])
    x = poses[..., 0, None] + cos * centres[:, 0] - sin * centres[:, 1]
    y = poses[..., 1, None] + sin * centres[:, 0] + cos * centres[:, 1]
    cell = elevation.cell_of(np.stack([x, y], axis=-1))
    n = elevation.n
    inside = ((cell >= 0) & (cell < n)).all(axis=-1)
    cell = np.clip(cell, 0, n - 1)
    distance = np.where(inside, field[cell[..., 1], cell[..., 0]], -np.inf)
    return distance.min(axis=-1) - radius


def arc_poses(start: np.ndarray, curvature: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """Poses along arcs of constant curvature.

    start: (..., 3) x, y, yaw; curvature: (...) [1/m], positive to the left; distance: (k,) [m], negative backwards.
    Returns (..., k, 3).
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
