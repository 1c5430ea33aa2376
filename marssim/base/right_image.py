"""Where the right image shows the points of the left one, if the right camera is turned a little.

The maps of a pair belong to the left image. A residual error of rectification turns the right camera in place, by the
rotation R from its camera frame to that of the ideal right camera. A left pixel (u, v) of depth Z shows the point P =
Z ((u - cx) / fx, (v - cy) / fy, 1). The right image shows it at the projection of R^T (P - (B, 0, 0)).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from marssim.base.camera import StereoRig
from marssim.base.compute.compiled import compiled, inlined, read_only

IDEAL = np.eye(3)
IDEAL.flags.writeable = False
UNIT_TOLERANCE = 1e-6  # by which a rotation may miss an orthonormal matrix


def image_disparity(rig: StereoRig, depth: np.ndarray, rotation: np.ndarray = IDEAL) -> np.ndarray:
    """Return the disparity that the images show: the column of a point in the left image minus that in the right one.

    For the ideal rotation it is exactly StereoRig.depth_to_disparity, f B / Z.

    Args:
        rig: The two cameras.
        depth: (H, W) float32 [m] of the left image.
        rotation: (3, 3) frame of the right camera to that of the ideal right camera.

    Returns:
        (H, W) float32 [px]; 0 where the depth is not finite. It can be 0 or negative for far points.
    """
    if np.array_equal(rotation, IDEAL):
        return rig.depth_to_disparity(depth)
    c = rig.camera
    return _disparity(read_only(depth, np.float32), read_only(rotation), c.fx, c.fy, c.cx, c.cy, rig.baseline)


def vertical_disparity(rig: StereoRig, depth: np.ndarray, rotation: np.ndarray = IDEAL) -> np.ndarray:
    """Return how much lower than in the left image a point lies in the right one.

    Args:
        rig: The two cameras.
        depth: (H, W) float32 [m] of the left image.
        rotation: (3, 3) frame of the right camera to that of the ideal right camera.

    Returns:
        (H, W) float32 [px]; 0 where the depth is not finite, and everywhere with the ideal camera.
    """
    if np.array_equal(rotation, IDEAL):
        return np.zeros(depth.shape, np.float32)
    known = np.isfinite(depth)
    points = rig.camera.unproject(np.where(known, depth, 1.0)) - [rig.baseline, 0, 0]
    lower = rig.camera.project(points @ rotation)[..., 1] - np.arange(rig.camera.height)[:, None]
    return np.where(known, lower, 0).astype(np.float32)


def outside_right(rig: StereoRig, depth: np.ndarray, rotation: np.ndarray = IDEAL) -> np.ndarray:
    """Return the left pixels whose points lie beyond the borders of the right image.

    Args:
        rig: The two cameras.
        depth: (H, W) float32 [m] of the left image.
        rotation: (3, 3) frame of the right camera to that of the ideal right camera.

    Returns:
        (H, W) bool; False where the depth is not finite.
    """
    c = rig.camera
    if np.array_equal(rotation, IDEAL):
        return np.isfinite(depth) & (np.arange(c.width) - rig.depth_to_disparity(depth) < -0.5)
    return _outside(read_only(depth, np.float32), read_only(rotation), c.fx, c.fy, c.cx, c.cy, rig.baseline)


def recorded_rotation(value: Any) -> np.ndarray:
    """Return the rotation that a sample.json records as "right_rotation".

    Args:
        value: The recorded value; None in datasets of version 2, whose disparity is that of the ideal rig.

    Returns:
        (3, 3) frame of the right camera to that of the ideal right camera.

    Raises:
        ValueError: The value is no rotation. One line that begins with the field's name.
    """
    if value is None:
        return IDEAL
    try:
        rotation = np.array(value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        rotation = np.zeros(0)
    if rotation.shape != (3, 3) or not is_rotation(rotation):
        raise ValueError("right_rotation is not a 3 x 3 rotation")
    return rotation


def is_rotation(matrix: np.ndarray) -> bool:
    """Return whether a (3, 3) matrix is orthonormal and right-handed, to 1e-6."""
    if not np.abs(matrix).max() < 2:  # products of larger numbers overflow
        return False
    return bool(np.abs(matrix @ matrix.T - np.eye(3)).max() < UNIT_TOLERANCE and np.linalg.det(matrix) > 0)


@compiled
def _disparity(depth, rotation, fx, fy, cx, cy, baseline):
    out = np.zeros(depth.shape, dtype=np.float32)
    for v in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            if np.isfinite(depth[v, u]):
                out[v, u] = u - _pixel(u, v, depth[v, u], rotation, fx, fy, cx, cy, baseline)[0]
    return out


@compiled
def _outside(depth, rotation, fx, fy, cx, cy, baseline):
    height, width = depth.shape
    out = np.zeros(depth.shape, dtype=np.bool_)
    for v in range(height):
        for u in range(width):
            if np.isfinite(depth[v, u]):
                column, row = _pixel(u, v, depth[v, u], rotation, fx, fy, cx, cy, baseline)
                out[v, u] = not (-0.5 <= column <= width - 0.5 and -0.5 <= row <= height - 0.5)
    return out


@inlined
def _pixel(u, v, depth, r, fx, fy, cx, cy, baseline):
    """Return column and row in the right image of the point that the left pixel (u, v) shows; r: its rotation."""
    z = float(depth)
    x, y = z * (u - cx) / fx - baseline, z * (v - cy) / fy
    ahead = r[0, 2] * x + r[1, 2] * y + r[2, 2] * z
    across = r[0, 0] * x + r[1, 0] * y + r[2, 0] * z
    down = r[0, 1] * x + r[1, 1] * y + r[2, 1] * z
    return cx + fx * across / ahead, cy + fy * down / ahead
