"""What a pixel sees: the contract between the renderers and everything after them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from marssim.base.camera import PinholeCamera, rotate
from marssim.base.dataset.frame import SKY

ROCK_SMOOTHNESS = 0.55  # length of a rock's interpolated normals: 1 shades it as if it were smooth, 0 facet by facet


class Hits(NamedTuple):
    """What N rays meet; as in GBuffer: depth (N,), normal (N, 3), shading_normal (N, 3), surface (N,)."""

    depth: np.ndarray
    normal: np.ndarray
    shading_normal: np.ndarray
    surface: np.ndarray


@dataclass(frozen=True)
class GBuffer:
    """Geometry through the pixel centres of one view.

    depth: (H, W) float32 [m], z along the optical axis; inf in the sky.
    normal: (H, W, 3) float32, camera frame, unit, facing the camera: of the triangle that is seen; 0 in the sky.
    shading_normal: (H, W, 3) float32, world frame: interpolated over the mesh, for shading only; 0 in the sky.
    surface: (H, W) int32, SKY, GROUND or rock n + 1.
    """

    depth: np.ndarray
    normal: np.ndarray
    shading_normal: np.ndarray
    surface: np.ndarray

    @property
    def hit(self) -> np.ndarray:
        """(H, W) bool: not sky."""
        return self.surface != SKY

    @property
    def pixels(self) -> Hits:
        """What the rays through the pixel centres meet, row by row."""
        return Hits(
            self.depth.ravel(), self.normal.reshape(-1, 3), self.shading_normal.reshape(-1, 3), self.surface.ravel()
        )

    def world(self, camera: PinholeCamera, pose: np.ndarray) -> np.ndarray:
        """(H, W, 3) float64 world position of each pixel; not finite in the sky. pose: (4, 4) camera to world."""
        points = rotate(camera.unproject(np.where(self.hit, self.depth, 0)), pose[:3, :3]) + pose[:3, 3]
        points[~self.hit] = np.inf
        return points


class GBufferMaker(Protocol):
    """Renders one Scene; close() frees what it holds and may be called twice."""

    def render(self, camera: PinholeCamera, pose: np.ndarray) -> GBuffer:
        """What the camera sees. pose: (4, 4) camera to world."""

    def lit(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """(N,) bool: does the sun's centre reach these surface points? points: (N, 3) world; normals: (N, 3) of the
        faces, world frame, used to step off the surface."""

    def seen_from(self, points: np.ndarray, normals: np.ndarray, eye: np.ndarray) -> np.ndarray:
        """(N,) bool: is the straight line from these surface points to the eye free? eye: (3,) world."""

    def trace(self, rays: np.ndarray, pose: np.ndarray) -> Hits:
        """What rays (N, 3) of z = 1 meet, camera frame, which need not pass through pixel centres."""

    def close(self) -> None: ...
