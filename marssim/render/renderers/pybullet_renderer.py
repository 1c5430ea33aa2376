"""The PyBullet renderer: PyBullet decides which surface each pixel shows, then the geometry is computed exactly."""

from __future__ import annotations

from threading import Lock

import numpy as np

from marssim.base.camera import PinholeCamera
from marssim.base.compute.compiled import compiled
from marssim.base.dataset.frame import GROUND, SKY
from marssim.render.geometry.gbuffer import Footprint, GBuffer
from marssim.render.geometry.hits import depths_of_faces
from marssim.render.geometry.raster import first_faces, matching_faces
from marssim.render.geometry.visibility import RayQueries
from marssim.render.renderers.bullet_tiles import BulletTiles
from marssim.render.renderers.egl_tiles import EglTiles
from marssim.scene.scene import Scene

SLIP = 0.002  # share of the depth by which what PyBullet draws may be off
NEAR = 0.1  # [m] near plane: nothing nearer to the camera is drawn


class PyBulletRenderer(RayQueries):
    """Renders a Scene with PyBullet's `getCameraImage`. Fulfils `Renderer`.

    PyBullet decides which surface each pixel shows and roughly how far away it is. Depth and normal are then those of
    the triangle of that surface which the pixel's ray hits nearest to that depth. So only one thing may differ from ray
    casting: which surface a pixel on a silhouette shows. Shadows, occlusion and sub-pixel samples are found by rays
    (visibility.py).

    Args:
        scene: The scene to render.
        egl: Draw with PyBullet's EGL renderer instead of TinyRenderer. Only one such renderer may be open in a process.

    Raises:
        ImportError: PyBullet is not installed.
        OSError: EGL does not work here.
        RuntimeError: Another renderer of this process draws with EGL.
    """

    def __init__(self, scene: Scene, egl: bool = False) -> None:
        super().__init__(scene)
        self._tiles = EglTiles(scene) if egl else BulletTiles(scene)
        self._drawing = Lock()
        self._group = self._tiles.group_of(self._surface.bodies.surface)

    def render(
        self, camera: PinholeCamera, pose: np.ndarray, footprint: Footprint | None = None, sunlit: bool = True
    ) -> GBuffer:
        """Return the G-buffer of one view; see `Renderer.render`. Nothing nearer than 0.1 m is visible."""
        surface, shape = self._open_surface(), (camera.height, camera.width)
        bodies = surface.bodies
        guess, group = self.drawn(camera, pose)
        drawn_ground = group.ravel() == GROUND
        group[group == GROUND] = SKY
        face = matching_faces(bodies, self._group, camera, pose, guess, group)
        _copy_neighbours(face.reshape(shape), group)
        _nearest_faces(
            face, group.ravel(), camera.rays().reshape(-1, 3), pose, bodies.vertices, bodies.faces, self._group,
            bodies.start,
        )  # fmt: skip
        # PyBullet draws flat ground; bodies that it hides may show where the relief lies lower
        first = np.where(drawn_ground, first_faces(bodies, camera, pose), -1)
        behind = depths_of_faces(bodies, pose, camera.rays().reshape(-1, 3), first) > (1 - SLIP) * guess.ravel()
        face = np.where(drawn_ground & behind, first, face)
        return surface.view(camera, pose, first_faces(surface.cap, camera, pose), face, footprint, sunlit)

    def drawn(self, camera: PinholeCamera, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return what PyBullet draws, before the geometry is made exact. pose: (4, 4) camera to world.

        Returns:
            (H, W) float64 depth [m], arbitrary in the sky, and (H, W) int32 groups: SKY, GROUND, or the number of one
            or several rocks (`BulletTiles.group_of`).
        """
        with self._drawing:  # it shows and hides bodies: one view at a time
            return self._tiles.draw(camera, pose, NEAR, self._farthest(pose[:3, 3]))

    def close(self) -> None:
        """Free the PyBullet world; a second call does nothing."""
        self._tiles.close()
        super().close()

    def _farthest(self, eye: np.ndarray) -> float:
        """Return a distance [m] from the eye (3,) beyond which there is nothing."""
        reach = np.maximum(np.abs(self._tiles.low - eye), np.abs(self._tiles.high - eye))
        return float(np.linalg.norm(reach)) + 1.0


@compiled
def _copy_neighbours(face, group):
    """Give a pixel whose ray just misses the group that PyBullet shows the face of a neighbour that shows it.

    That happens on silhouettes. face, group: (H, W); face is changed in place.
    """
    height, width = face.shape
    before = face.copy()
    for row in range(height):
        for column in range(width):
            if group[row, column] == SKY or before[row, column] >= 0:
                continue
            for j in range(max(row - 1, 0), min(row + 2, height)):
                for i in range(max(column - 1, 0), min(column + 2, width)):
                    if before[j, i] >= 0 and group[j, i] == group[row, column]:
                        face[row, column] = before[j, i]


@compiled
def _nearest_faces(face, group, rays, pose, vertices, faces, face_group, start):
    """Where no neighbour shows the group either, take the face of the group whose middle lies nearest to the ray."""
    for k in range(len(face)):
        if group[k] == SKY or face[k] >= 0:
            continue
        best = np.inf
        for piece in range(len(start) - 1):
            if face_group[start[piece]] != group[k]:
                continue
            for f in range(start[piece], start[piece + 1]):
                x, y, z = 0.0, 0.0, 0.0
                for c in range(3):
                    v = faces[f, c]
                    px, py, pz = vertices[v, 0] - pose[0, 3], vertices[v, 1] - pose[1, 3], vertices[v, 2] - pose[2, 3]
                    x += pose[0, 0] * px + pose[1, 0] * py + pose[2, 0] * pz
                    y += pose[0, 1] * px + pose[1, 1] * py + pose[2, 1] * pz
                    z += pose[0, 2] * px + pose[1, 2] * py + pose[2, 2] * pz
                if z > 0:
                    off = (x / z - rays[k, 0]) ** 2 + (y / z - rays[k, 1]) ** 2
                    if off < best:
                        best = off
                        face[k] = f
