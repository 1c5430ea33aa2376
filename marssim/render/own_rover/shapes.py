"""Closed shapes of triangles, turned outwards, of which the rover is built."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from marssim.base.pose import moved

CORNERS = 16  # of the circle of a wheel


class Shape(NamedTuple):
    """A closed surface of one material.

    Attributes:
        vertices: (V, 3) [m].
        faces: (F, 3) int32, counter-clockwise as seen from outside.
        material: Number of its material, see materials.py.
    """

    vertices: np.ndarray
    faces: np.ndarray
    material: int

    def moved(self, pose: np.ndarray) -> Shape:
        """Return the shape moved by a rigid motion (4, 4)."""
        return self._replace(vertices=moved(self.vertices, pose))


def prism(outline: np.ndarray, low: float, high: float, material: int) -> Shape:
    """Return an upright prism.

    Args:
        outline: (N, 2) corners x, y of a convex polygon, counter-clockwise from above [m].
        low: Height of its lower face [m].
        high: Height of its upper face [m].
        material: Its material.
    """
    n, outline = len(outline), np.asarray(outline, dtype=float)
    vertices = np.concatenate([np.column_stack([outline, np.full(n, height)]) for height in (low, high)])
    fan = [(0, k, k + 1) for k in range(1, n - 1)]
    faces = [(a, c, b) for a, b, c in fan] + [(a + n, b + n, c + n) for a, b, c in fan]
    for k in range(n):
        after = (k + 1) % n
        faces += [(k, after, after + n), (k, after + n, k + n)]
    return Shape(vertices, np.array(faces, dtype=np.int32), material)


def box(low: tuple[float, float, float], high: tuple[float, float, float], material: int) -> Shape:
    """Return the box between two opposite corners [m]."""
    outline = np.array([(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])])
    return prism(outline, low[2], high[2], material)


def disc(radius: float, width: float, material: int) -> Shape:
    """Return a disc about the z axis, from -width / 2 to width / 2 [m]."""
    turn = np.arange(CORNERS) * 2 * np.pi / CORNERS
    return prism(radius * np.column_stack([np.cos(turn), np.sin(turn)]), -width / 2, width / 2, material)


def beam(first: np.ndarray, last: np.ndarray, width: float, material: int) -> Shape:
    """Return a square beam between two points (3,) [m]."""
    axis = np.asarray(last, dtype=float) - first
    length = float(np.linalg.norm(axis))
    axis = axis / length
    helper = np.array([0.0, 0.0, 1.0]) if abs(axis[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    across = np.cross(helper, axis)
    across /= np.linalg.norm(across)
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([across, np.cross(axis, across), axis])
    pose[:3, 3] = first
    half = width / 2
    return box((-half, -half, 0.0), (half, half, length), material).moved(pose)
