"""What stands between a point and the sun or an eye, and what rays from an eye meet, for all triangles of a Scene."""

from __future__ import annotations

import numpy as np
from numba import njit

from marssim.render.hits import hits
from marssim.render.mesh import SceneMesh
from marssim.render.scan import Projection, blocked, nearest

SELF_GAP = 2e-3  # [m] rays from a surface start this far off it, against meeting the face they leave


class Visibility:
    """Exact answers by rays, from the triangles alone; see scan.py."""

    def __init__(self, mesh: SceneMesh, sun: np.ndarray) -> None:
        self.mesh = mesh
        self.sun = sun

    def trace(self, rays: np.ndarray, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Depth, normal, shading normal and surface id along rays (N, 3) of z = 1; see GBufferMaker."""
        mesh = self.mesh
        if len(rays) == 0:
            face = np.zeros(0, dtype=np.int32)
        else:
            face = nearest(mesh, Projection.of_eye(pose), rays[:, 0], rays[:, 1])
        return hits(mesh.vertices, mesh.faces, mesh.surface, mesh.vertex_normals, pose, rays, face)

    def lit(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """(N,) bool: the sun's centre reaches these surface points; see GBufferMaker."""
        towards = np.broadcast_to(self.sun, (1, 3))
        return self._open(points, normals, towards, Projection.of_sun(self.sun))

    def seen_from(self, points: np.ndarray, normals: np.ndarray, eye: np.ndarray) -> np.ndarray:
        """(N,) bool: nothing stands between these surface points and the eye (3,); see GBufferMaker.

        An eye looks one way: points all round it are looked at in as many views as it takes, each of less than a half
        space.
        """
        eye = np.asarray(eye, dtype=float)
        out = np.zeros(len(points), dtype=bool)
        if len(points) == 0:
            return out
        towards = eye - points
        axis = -np.median(towards[:: max(1, len(points) // 512)], axis=0)
        ahead = (towards @ axis) < -0.3 * np.linalg.norm(towards, axis=1) * np.linalg.norm(axis)
        if ahead.all():
            return self._open(points, normals, towards, Projection.of_eye(_looking(eye, axis)))
        side = np.abs(towards).argmax(axis=1)
        sign = np.sign(-towards[np.arange(len(points)), side])
        for axis_number in range(3):
            for direction in (-1.0, 1.0):
                at = np.flatnonzero((side == axis_number) & (sign == direction))
                if len(at):
                    view = Projection.of_eye(_looking(eye, direction * np.eye(3)[axis_number]))
                    out[at] = self._open(points[at], normals[at], towards[at], view)
        return out

    def _open(self, points: np.ndarray, normals: np.ndarray, towards: np.ndarray, view: Projection) -> np.ndarray:
        """(N,) bool: the face looks towards the light or eye, (N, 3) or (1, 3), and nothing stands in the way."""
        at, start = _leaving(
            np.ascontiguousarray(points, dtype=float), np.ascontiguousarray(normals, dtype=float), towards
        )
        out = np.zeros(len(points), dtype=bool)
        if len(at):
            out[at] = ~blocked(self.mesh, view, *view.apply(start))
        return out


def _looking(eye: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """(4, 4) pose of a camera at the eye (3,) that looks along the axis (3,)."""
    forward = axis / np.linalg.norm(axis)
    helper = np.array([0.0, 0.0, 1.0]) if abs(forward[2]) < 0.9 else np.array([0.0, 1.0, 0.0])
    right = np.cross(forward, helper)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    pose[:3, 3] = eye
    return pose


@njit(cache=True, error_model="numpy")
def _leaving(points, normals, towards):
    """Indices of the points whose face looks towards the light or eye, and where their rays start."""
    n = len(points)
    at, start = np.empty(n, dtype=np.int64), np.empty((n, 3))
    found = 0
    for k in range(n):
        t = k if len(towards) == n else 0
        facing = normals[k, 0] * towards[t, 0] + normals[k, 1] * towards[t, 1] + normals[k, 2] * towards[t, 2]
        if facing > 0:
            at[found] = k
            for axis in range(3):
                start[found, axis] = points[k, axis] + SELF_GAP * normals[k, axis]
            found += 1
    return at[:found], start[:found]
