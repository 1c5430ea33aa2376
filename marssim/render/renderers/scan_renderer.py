"""The G-buffer by scan conversion in double precision: the triangles themselves, nothing built, no other library."""

from __future__ import annotations

import numpy as np

from marssim.base.camera import PinholeCamera
from marssim.render.geometry.gbuffer import GBuffer
from marssim.render.geometry.hits import seen
from marssim.render.geometry.mesh import scene_mesh
from marssim.render.geometry.raster import first_faces
from marssim.render.geometry.visibility import SeesByRays
from marssim.scene.scene import Scene


class Scanner(SeesByRays):
    """Renders a Scene by its triangles alone. Implements GBufferMaker."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene_mesh(scene), scene.look.sun)
        self.scene = scene

    def render(self, camera: PinholeCamera, pose: np.ndarray) -> GBuffer:
        """What the camera sees; see GBuffer. pose: (4, 4) camera to world."""
        mesh = self._seer().mesh
        return seen(mesh, camera, pose, first_faces(mesh, camera, pose))
