"""Visibility by rays through all triangles of a scene: shadows, lines of sight, and what rays from an eye hit."""

from __future__ import annotations

import numpy as np

from marssim.base.compute.compiled import compiled, read_only
from marssim.base.pose import rigid_pose
from marssim.render.geometry.disc import disc_share
from marssim.render.geometry.gbuffer import Footprint, Hits
from marssim.render.geometry.mesh import SceneMesh, faces_away_from, scene_mesh
from marssim.render.geometry.projection import Projection
from marssim.render.geometry.scan import first_faces_of_rays, obstacles
from marssim.render.geometry.surface import SceneSurface
from marssim.scene.look import SUN_RADIUS
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
        return self.shadow_distance(points, normals) == np.inf

    def shadow_distance(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Return how far what hides the sun's centre is from surface points; see `Renderer.shadow_distance`."""
        view = Projection.of_sun(self.sun)
        at, x, y, s = self._leaving(points, normals, view)
        out = np.zeros(len(points), dtype=np.float32)
        if len(at):
            height = obstacles(self._casting, view, x, y, s)
            out[at] = np.where(height == np.inf, np.inf, s - height)
        return out

    def sun_share(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Return the share of the sun's disc that surface points see; see `Renderer.sun_share`."""
        view = Projection.of_sun(self.sun)
        at, x, y, s = self._leaving(points, normals, view)
        out = np.zeros(len(points), dtype=np.float32)
        if len(at):
            out[at] = disc_share(self._casting, view, x, y, s, SUN_RADIUS)
        return out

    def _leaving(self, points: np.ndarray, normals: np.ndarray, view: Projection) -> tuple[np.ndarray, ...]:
        points, normals = np.asarray(points), np.asarray(normals)
        if points.ndim != 2 or points.shape[1] != 3 or normals.shape != points.shape:
            raise ValueError(f"points and normals must both have shape (N, 3), got {points.shape} and {normals.shape}")
        if not np.isfinite(points).all():
            raise ValueError("points must be finite numbers")
        return _leaving(
            read_only(points), read_only(normals, np.float32), read_only(self.sun), view.axes, view.shift
        )  # fmt: skip


class RayQueries:
    """The methods of a `Renderer` that are answered by rays through all triangles, until it is closed."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self._surface = SceneSurface(scene)
        self._visibility = Visibility(scene_mesh(scene), scene.look.sun)
        self._open = True

    def trace(
        self, rays: np.ndarray, pose: np.ndarray, footprint: Footprint, sunlit: bool = True,
        begin: np.ndarray | None = None,
    ) -> Hits:  # fmt: skip
        """Return what rays (N, 3) of z = 1 hit; see `Renderer.trace`."""
        surface = self._open_surface()
        rays, pose, begin = _checked(rays, pose, begin)
        unknown = np.flatnonzero(begin == 0)
        begin[unknown] = surface.begins(pose, rays[unknown], self._cap_faces(rays[unknown], pose))
        return surface.hits_from(pose, rays, begin, self._body_faces(rays, pose), footprint, sunlit)

    def trace_ground(
        self, rays: np.ndarray, pose: np.ndarray, begin: np.ndarray, footprint: Footprint, sunlit: bool = True
    ) -> Hits:
        """Return where rays that are known to meet the ground do so; see `Renderer.trace_ground`."""
        surface = self._open_surface()
        rays, pose, begin = _checked(rays, pose, begin)
        none = np.full(len(rays), -1, dtype=np.int32)
        return surface.hits_from(pose, rays, begin, none, footprint, sunlit)

    def lit(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Return which surface points the sun's centre reaches; see `Renderer.lit`."""
        self._open_surface()
        return self._visibility.lit(points, normals)

    def shadow_distance(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Return how far what hides the sun's centre is from surface points; see `Renderer.shadow_distance`."""
        self._open_surface()
        return self._visibility.shadow_distance(points, normals)

    def sun_share(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Return the share of the sun's disc that surface points see; see `Renderer.sun_share`."""
        self._open_surface()
        return self._visibility.sun_share(points, normals)

    def close(self) -> None:
        """Refuse all further queries; a second call does nothing."""
        self._open = False

    def _cap_faces(self, rays: np.ndarray, pose: np.ndarray) -> np.ndarray:
        """Return the faces (N,) int32 of the cap that each ray hits first, negative for none."""
        return first_faces_of_rays(self._surface.cap, rays, pose)

    def _body_faces(self, rays: np.ndarray, pose: np.ndarray) -> np.ndarray:
        """Return the faces (N,) int32 of the bodies that each ray hits first, negative for none."""
        return first_faces_of_rays(self._surface.bodies, rays, pose)

    def _open_surface(self) -> SceneSurface:
        if not self._open:
            raise RuntimeError(f"this {type(self).__name__} is closed")
        return self._surface


def _checked(rays: np.ndarray, pose: np.ndarray, begin: np.ndarray | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return rays, pose and a copy of the depths at which rays begin, 0 for None. Raises ValueError that names one."""
    rays = np.asarray(rays)
    if rays.ndim != 2 or rays.shape[1] != 3 or not np.isfinite(rays).all():
        raise ValueError(f"rays must be finite numbers of shape (N, 3), got {rays.shape}")
    start = np.zeros(len(rays)) if begin is None else np.array(begin, dtype=float)
    if start.shape != (len(rays),) or np.isnan(start).any():
        raise ValueError(f"begin must be one number for each of {len(rays)} rays, got {start.shape}")
    return rays, rigid_pose(pose), start


@compiled
def _leaving(points, normals, sun, axes, shift):
    """Return the points whose faces are turned to the sun, and the image x, image y and S where their rays start."""
    n = len(points)
    at, x, y, s = np.empty(n, dtype=np.int32), np.empty(n), np.empty(n), np.empty(n)
    count = 0
    for k in range(n):
        px, py, pz = points[k, 0], points[k, 1], points[k, 2]
        nx, ny, nz = normals[k, 0], normals[k, 1], normals[k, 2]
        if nx * sun[0] + ny * sun[1] + nz * sun[2] > 0:
            px, py, pz = px + SELF_GAP * nx, py + SELF_GAP * ny, pz + SELF_GAP * nz
            at[count] = k
            x[count] = axes[0, 0] * px + axes[0, 1] * py + axes[0, 2] * pz + shift[0]
            y[count] = axes[1, 0] * px + axes[1, 1] * py + axes[1, 2] * pz + shift[1]
            s[count] = axes[3, 0] * px + axes[3, 1] * py + axes[3, 2] * pz + shift[3]
            count += 1
    return at[:count], x[:count], y[:count], s[:count]
