"""The true ground that is an obstacle without any rock: too steep for the rover, or with a drop in it."""

from __future__ import annotations

import cv2
import numpy as np

from marssim.base.rover_spec import RoverSpec
from marssim.scene.terrain import Terrain

FOOTPRINT = 1.1  # [m] side of the square whose plane has the slope: most of the rover's footprint
DROP_WITHIN = 0.4  # [m] within which ground of different heights counts as a drop: a wheel and a little more


def steep_ground(terrain: Terrain, spec: RoverSpec, half: float, cell: float) -> np.ndarray:
    """Mark the ground that the rover must not enter.

    That is ground whose plane over a footprint is steeper than spec.max_slope, and ground that has a height difference
    of spec.obstacle_height or more within 0.4 m: the brink and the wall of a ditch, a ledge, the rim of a fresh crater.

    Args:
        terrain: The ground.
        spec: The rover.
        half: Half the side of the marked square [m].
        cell: Grid spacing [m].

    Returns:
        (n, n) bool; row j lies at y = -half + j cell, column i at x = -half + i cell.
    """
    axis = np.arange(int(np.ceil(2 * half / cell)) + 1) * cell - half
    heights = terrain.height_at(*np.meshgrid(axis, axis))
    return (_slope(heights, cell) > np.tan(spec.max_slope)) | (_drop(heights, cell) >= spec.obstacle_height)


def _slope(heights: np.ndarray, cell: float) -> np.ndarray:
    """Return the tangent of the slope of the least-squares plane around each node."""
    reach = round(FOOTPRINT / cell / 2)
    along = np.arange(-reach, reach + 1) * cell
    ramp, level = along / np.sum(along**2), np.full(len(along), 1 / len(along))
    # at the border the ground goes on as it rises there
    padded = np.pad(heights, reach, mode="reflect", reflect_type="odd")
    inner = np.s_[reach:-reach, reach:-reach]
    east = cv2.sepFilter2D(padded, cv2.CV_64F, ramp, level)[inner]
    north = cv2.sepFilter2D(padded, cv2.CV_64F, level, ramp)[inner]
    return np.hypot(east, north)


def _drop(heights: np.ndarray, cell: float) -> np.ndarray:
    """Return the height difference within the disc of diameter DROP_WITHIN around each node [m]."""
    size = 2 * round(DROP_WITHIN / cell / 2) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    return np.asarray(cv2.dilate(heights, disc) - cv2.erode(heights, disc))
