"""Visibility by rays through all triangles of a scene: shadows, lines of sight, and what rays from an eye hit."""

from __future__ import annotations

import math

import numpy as np

from marssim.base.compute.compiled import compiled, read_only
from marssim.render.geometry.gbuffer import Footprint, Hits
from marssim.render.geometry.mesh import SceneMesh, faces_away_from, scene_mesh
from marssim.render.geometry.projection import Projection
from marssim.render.geometry.scan import nearest_faces, unobstructed
from marssim.render.geometry.surface import SceneSurface
from marssim.scene.scene import Scene

SELF_GAP = 2e-4  # [m] distance from a surface at which its rays start, so that they do not hit their own face


class Visibility:
    """Exact visibility by rays, from the triangles alone (scan.py).

    Args:
        mesh: The scene's mesh.
        sun: (3,) unit vector towards the sun.
    """

    def __init__(self, mesh: SceneMesh, sun: np.ndarray) -> None:
        self.mesh = mesh
        self.sun = sun
        self._casting = faces_away_from(mesh, sun)

    def lit(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Return which surface points the sun's centre reaches; see `Renderer.lit`. No point may lie inside a rock."""
        return self._open(points, normals, self.sun, False, Projection.of_sun(self.sun), self._casting)

    def _open(
        self, points: np.ndarray, normals: np.ndarray, light: np.ndarray, near: bool, view: Projection, mesh: SceneMesh
    ) -> np.ndarray:
        """Return (N,) bool: the face is turned to the light and nothing is in the way.

        light: (3,) position if near, else direction; view: projection of that light.
        """
        at, x, y, s = _leaving(
            read_only(points), read_only(normals, np.float32), read_only(light), near, view.axes, view.shift,
        )  # fmt: skip
        out = np.zeros(len(points), dtype=bool)
        if len(at):
            out[at] = unobstructed(mesh, view, x, y, s)
        return out


class RayQueries:
    """The methods of a `Renderer` that are answered by rays through all triangles, until it is closed."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self._surface = SceneSurface(scene)
        self._visibility = Visibility(scene_mesh(scene), scene.look.sun)
        self._open = True

    def trace(self, rays: np.ndarray, pose: np.ndarray, footprint: Footprint, sunlit: bool = True) -> Hits:
        """Return what rays (N, 3) of z = 1 hit; see `Renderer.trace`."""
        surface = self._open_surface()
        view = Projection.of_eye(pose)
        x, y = np.ascontiguousarray(rays[:, 0]), np.ascontiguousarray(rays[:, 1])
        if len(rays) == 0:
            cap = body = np.zeros(0, dtype=np.int32)
        else:
            cap, body = (nearest_faces(mesh, view, x, y) for mesh in (surface.cap, surface.bodies))
        return surface.hits(pose, rays, cap, body, footprint, sunlit)

    def trace_ground(
        self, rays: np.ndarray, pose: np.ndarray, begin: np.ndarray, footprint: Footprint, sunlit: bool = True
    ) -> Hits:
        """Return where rays that are known to meet the ground do so; see `Renderer.trace_ground`."""
        none = np.full(len(rays), -1, dtype=np.int32)
        return self._open_surface().hits_from(pose, rays, begin, none, footprint, sunlit)

    def lit(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Return which surface points the sun's centre reaches; see `Renderer.lit`."""
        self._open_surface()
        return self._visibility.lit(points, normals)

    def close(self) -> None:
        """Refuse all further queries; a second call does nothing."""
        self._open = False

    def _open_surface(self) -> SceneSurface:
        if not self._open:
            raise RuntimeError(f"this {type(self).__name__} is closed")
        return self._surface


def _looking(eye: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Return the pose (4, 4) of a camera at the eye (3,) that looks along the axis (3,)."""
    forward = axis / np.linalg.norm(axis)
    helper = np.array([0.0, 0.0, 1.0]) if abs(forward[2]) < 0.9 else np.array([0.0, 1.0, 0.0])
    right = np.cross(forward, helper)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    pose[:3, 3] = eye
    return pose


@compiled
def _ahead(points, eye, axis):
    """Return whether all points lie well in front of an eye that looks along the axis."""
    least = 0.3 * math.sqrt(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2])
    for k in range(len(points)):
        x, y, z = points[k, 0] - eye[0], points[k, 1] - eye[1], points[k, 2] - eye[2]
        if not x * axis[0] + y * axis[1] + z * axis[2] > least * math.sqrt(x * x + y * y + z * z):
            return False
    return True


@compiled
def _leaving(points, normals, light, near, axes, shift):
    """Return the points whose faces are turned to the light, and the image x, image y and S where their rays start."""
    n = len(points)
    at, x, y, s = np.empty(n, dtype=np.int32), np.empty(n), np.empty(n), np.empty(n)
    count = 0
    for k in range(n):
        px, py, pz = points[k, 0], points[k, 1], points[k, 2]
        nx, ny, nz = normals[k, 0], normals[k, 1], normals[k, 2]
        tx, ty, tz = light[0], light[1], light[2]
        if near:
            tx, ty, tz = tx - px, ty - py, tz - pz
        if nx * tx + ny * ty + nz * tz > 0:
            px, py, pz = px + SELF_GAP * nx, py + SELF_GAP * ny, pz + SELF_GAP * nz
            w = axes[2, 0] * px + axes[2, 1] * py + axes[2, 2] * pz + shift[2]
            at[count] = k
            x[count] = (axes[0, 0] * px + axes[0, 1] * py + axes[0, 2] * pz + shift[0]) / w
            y[count] = (axes[1, 0] * px + axes[1, 1] * py + axes[1, 2] * pz + shift[1]) / w
            s[count] = axes[3, 0] * px + axes[3, 1] * py + axes[3, 2] * pz + shift[3]
            count += 1
    return at[:count], x[:count], y[:count], s[:count]
