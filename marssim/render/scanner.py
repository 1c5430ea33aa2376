"""The G-buffer by scan conversion in double precision: the triangles themselves, nothing built, no other library."""

from __future__ import annotations

import numpy as np

from marssim.camera import PinholeCamera
from marssim.render.gbuffer import GBuffer
from marssim.render.hits import seen
from marssim.render.mesh import scene_mesh
from marssim.render.raster import first_faces
from marssim.render.visibility import Visibility
from marssim.scene.scene import Scene


class Scanner:
    """Renders a Scene by its triangles alone. Implements GBufferMaker."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self._mesh = scene_mesh(scene)
        self._visibility = Visibility(self._mesh, scene.look.sun)
        self._open = True

    def render(self, camera: PinholeCamera, pose: np.ndarray) -> GBuffer:
        """What the camera sees; see GBuffer. pose: (4, 4) camera to world."""
        visibility = self._seer()
        return seen(visibility.mesh, camera, pose, first_faces(visibility.mesh, camera, pose))

    def trace(self, rays: np.ndarray, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Depth, normals, shading normals and surface along rays (N, 3) of z = 1; see GBufferMaker."""
        return self._seer().trace(rays, pose)

    def lit(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """(N,) bool: the sun's centre reaches these surface points; see GBufferMaker."""
        return self._seer().lit(points, normals)

    def seen_from(self, points: np.ndarray, normals: np.ndarray, eye: np.ndarray) -> np.ndarray:
        """(N,) bool: nothing stands between these surface points and the eye; see GBufferMaker."""
        return self._seer().seen_from(points, normals, eye)

    def close(self) -> None:
        """There is nothing to free; it is not to be used after. May be called twice."""
        self._open = False

    def _seer(self) -> Visibility:
        if not self._open:
            raise RuntimeError("this Scanner is closed")
        return self._visibility
