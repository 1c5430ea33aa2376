"""Poses of cameras, and rotations of many vectors.

A pose is the 4 x 4 matrix that takes camera coordinates (x right, y down, z forward) to world coordinates (x east, y
north, z up).
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

RIGID = 1e-3  # by which a recorded rotation may miss an orthonormal matrix
FARTHEST = 1e6  # [m] largest coordinate of a camera
ROVER_KEY = "camera_to_rover"  # by which files name the pose of the left camera on the rover


def rotate(vectors: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Return vectors @ matrix.T for many short vectors, many times as fast as BLAS does for such thin arrays.

    Args:
        vectors: (..., 3).
        matrix: (3, 3) or (2, 3).

    Returns:
        (..., 3) or (..., 2) of the vectors' dtype.
    """
    if vectors.size == 0:
        return np.zeros((*vectors.shape[:-1], len(matrix)), dtype=vectors.dtype)
    flat = np.ascontiguousarray(vectors).reshape(-1, 1, 3)
    return cv2.transform(flat, matrix).reshape(*vectors.shape[:-1], len(matrix))


def moved(points: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Return points (N, 3) or (3,) of the frame that a pose (4, 4) leads from, in the one that it leads to."""
    return np.asarray(points @ pose[:3, :3].T + pose[:3, 3])


def planar_pose(pose: np.ndarray) -> np.ndarray:
    """Return where a body stands on the map, (3,): x, y [m] and its heading from x [rad], positive to the left.

    Args:
        pose: (4, 4) body to world; the body's x axis points ahead.
    """
    return np.array([pose[0, 3], pose[1, 3], np.arctan2(pose[1, 0], pose[0, 0])])


def look_pose(position: np.ndarray, yaw: float, pitch: float, roll: float = 0.0) -> np.ndarray:
    """Return the pose of a camera from its position and three angles.

    Args:
        position: (3,) [m], world frame.
        yaw: Viewing direction [rad] from world x, counter-clockwise seen from above.
        pitch: How far the camera looks down from the horizon [rad].
        roll: Turn about the optical axis [rad], clockwise as seen from behind the camera.

    Returns:
        (4, 4) camera to world.
    """
    cy, sy, cp, sp = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch)
    forward = np.array([cy * cp, sy * cp, -sp])
    right = np.array([sy, -cy, 0.0])
    down = np.cross(forward, right)
    cr, sr = np.cos(roll), np.sin(roll)
    pose = np.eye(4)
    pose[:3, 0] = cr * right + sr * down
    pose[:3, 1] = -sr * right + cr * down
    pose[:3, 2] = forward
    pose[:3, 3] = position
    return pose


def recorded_pose(value: Any) -> np.ndarray:
    """Return the pose that a file records.

    Args:
        value: Content of the field: four lists of four numbers.

    Returns:
        (4, 4) camera to world.

    Raises:
        ValueError: It is no rotation and translation, or lies beyond FARTHEST. One line that begins with "pose".
    """
    pose = rigid_pose(value)
    if np.abs(pose[:3, 3]).max() > FARTHEST:
        raise ValueError(f"pose must lie within {FARTHEST:g} m of the origin")
    return pose


def rigid_pose(value: Any) -> np.ndarray:
    """Return a pose, a new (4, 4) array, of an array or of lists of numbers.

    Raises:
        ValueError: It is no rotation and translation. One line that begins with "pose".
    """
    try:
        pose = np.array(value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        pose = np.zeros(0)
    if pose.shape != (4, 4) or not np.isfinite(pose).all():
        raise ValueError("pose must be 4 rows of 4 finite numbers")
    turn = pose[:3, :3]
    rigid = np.abs(turn).max() < 2 and np.abs(turn @ turn.T - np.eye(3)).max() < RIGID and np.linalg.det(turn) > 0
    if not rigid or not np.array_equal(pose[3], [0, 0, 0, 1]):
        raise ValueError("pose must be a rotation and a translation above the row 0 0 0 1")
    return pose
