"""The scan renderer: scan conversion of the triangles in double precision, without any other library."""

from __future__ import annotations

import numpy as np

from marssim.base.camera import PinholeCamera
from marssim.render.geometry.gbuffer import Footprint, GBuffer
from marssim.render.geometry.raster import first_faces
from marssim.render.geometry.visibility import RayQueries


class ScanRenderer(RayQueries):
    """Renders a Scene by scan conversion of its triangles. Fulfils `Renderer`, without a library."""

    def render(
        self, camera: PinholeCamera, pose: np.ndarray, footprint: Footprint | None = None, sunlit: bool = True
    ) -> GBuffer:
        """Return the G-buffer of one view; see `Renderer.render`."""
        surface = self._open_surface()
        cap, body = (first_faces(mesh, camera, pose) for mesh in (surface.cap, surface.bodies))
        return surface.view(camera, pose, cap, body, footprint, sunlit)
