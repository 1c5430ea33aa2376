"""The scan renderer: scan conversion of the triangles in double precision, without any other library."""

from __future__ import annotations

import numpy as np

from marssim.base.camera import PinholeCamera
from marssim.render.geometry.gbuffer import GBuffer
from marssim.render.geometry.hits import gbuffer_of_faces
from marssim.render.geometry.mesh import scene_mesh
from marssim.render.geometry.raster import first_faces
from marssim.render.geometry.visibility import RayQueries
from marssim.scene.scene import Scene


class ScanRenderer(RayQueries):
    """Renders a Scene by scan conversion of its triangles. Fulfils `Renderer`; the fastest of the three."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene_mesh(scene), scene.look.sun)
        self.scene = scene

    def render(self, camera: PinholeCamera, pose: np.ndarray) -> GBuffer:
        """Return the G-buffer of one view. pose: (4, 4) camera to world."""
        mesh = self._open_visibility().mesh
        return gbuffer_of_faces(mesh, camera, pose, first_faces(mesh, camera, pose))
