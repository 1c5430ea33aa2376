"""Masks of the map's cells by place: under the rover, around positions, and outside an area."""

from __future__ import annotations

import cv2
import numpy as np

from nav.ground.elevation import ElevationMap

Area = tuple[float, float, float, float]
"""x0, y0, x1, y1 of a rectangle in the world [m]."""


def rectangle_mask(elevation: ElevationMap, pose: np.ndarray, half_length: float, half_width: float) -> np.ndarray:
    """Mark the cells of a rectangle around a pose.

    Args:
        elevation: The map.
        pose: (3,) x, y [m], yaw [rad] of the rectangle's middle.
        half_length: Half its side along the heading [m].
        half_width: Half its side across [m].

    Returns:
        (n, n) bool.
    """
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * np.array([half_length, half_width])
    c, s = np.cos(pose[2]), np.sin(pose[2])
    corners = elevation.cell_of(pose[:2] + corners @ np.array([[c, s], [-s, c]]))
    mask = np.zeros((elevation.n, elevation.n), np.uint8)
    cv2.fillConvexPoly(mask, corners.astype(np.int32), 1)
    return mask > 0


def disc_mask(elevation: ElevationMap, centres: list[np.ndarray], radius: float) -> np.ndarray:
    """Mark the cells near any of several positions.

    Args:
        elevation: The map.
        centres: World positions (2,) [m], one or more.
        radius: Distance within which a cell is marked [m].

    Returns:
        (n, n) bool.
    """
    mask = np.zeros((elevation.n, elevation.n), np.uint8)
    for cell in elevation.cell_of(np.array(centres)):
        cv2.circle(mask, (int(cell[0]), int(cell[1])), round(radius / elevation.config.cell), 1, -1)
    return mask > 0


def outside_mask(elevation: ElevationMap, area: Area, beyond: float) -> np.ndarray:
    """Mark the cells that lie outside an area by more than a distance.

    Args:
        elevation: The map.
        area: The area.
        beyond: The distance [m].

    Returns:
        (n, n) bool.
    """
    x, y = elevation.centres()
    outside_x = (x < area[0] - beyond) | (x > area[2] + beyond)
    outside_y = (y < area[1] - beyond) | (y > area[3] + beyond)
    return np.asarray(outside_x[None, :] | outside_y[:, None])
