"""The G-buffer: what each pixel of a view shows. Renderers fill it, and everything after them reads it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from marssim.base.camera import PinholeCamera
from marssim.base.dataset.frame import SKY
from marssim.base.pose import rotate

ROCK_SMOOTHNESS = 0.55  # length of a rock's interpolated normals: 1 shades a rock smoothly, 0 facet by facet


class Hits(NamedTuple):
    """What N rays hit. Units and frames are those of GBuffer.

    Attributes:
        depth: (N,) float32 [m], inf in the sky.
        normal: (N, 3) float32, camera frame.
        shading_normal: (N, 3) float32, world frame.
        surface: (N,) int32, SKY, GROUND or rock n + 1.
    """

    depth: np.ndarray
    normal: np.ndarray
    shading_normal: np.ndarray
    surface: np.ndarray


@dataclass(frozen=True)
class GBuffer:
    """Geometry of one view, sampled at the pixel centres.

    Attributes:
        depth: (H, W) float32 [m], z along the optical axis; inf in the sky.
        normal: (H, W, 3) float32 unit normal of the visible triangle, camera frame, facing the camera; 0 in the sky.
        shading_normal: (H, W, 3) float32 normal interpolated over the mesh, world frame, for shading only; 0 in the
            sky.
        surface: (H, W) int32 id: SKY, GROUND or rock n + 1.
    """

    depth: np.ndarray
    normal: np.ndarray
    shading_normal: np.ndarray
    surface: np.ndarray

    @property
    def hit(self) -> np.ndarray:
        """(H, W) bool: the pixels that show a surface, not the sky."""
        return self.surface != SKY

    @property
    def pixels(self) -> Hits:
        """What the rays through the pixel centres hit, row by row."""
        return Hits(
            self.depth.ravel(), self.normal.reshape(-1, 3), self.shading_normal.reshape(-1, 3), self.surface.ravel()
        )

    def world(self, camera: PinholeCamera, pose: np.ndarray) -> np.ndarray:
        """Return the world position of each pixel.

        Args:
            camera: The camera of this view.
            pose: (4, 4) camera to world.

        Returns:
            (H, W, 3) float64 [m]; inf in the sky.
        """
        points = rotate(camera.unproject(np.where(self.hit, self.depth, 0)), pose[:3, :3]) + pose[:3, 3]
        points[~self.hit] = np.inf
        return points
