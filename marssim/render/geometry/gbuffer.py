"""The G-buffer: what each pixel of a view shows. Renderers fill it, and everything after them reads it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from marssim.base.camera import PinholeCamera
from marssim.base.dataset.frame import SKY
from marssim.base.pose import rotate

ROCK_SMOOTHNESS = 0.55  # length of a rock's interpolated normals: 1 shades a rock smoothly, 0 facet by facet


class Footprint(NamedTuple):
    """What decides how much relief shows: the camera whose pixels the relief is filtered for.

    Both images of a pair are filtered for the left camera, so that they show one surface.

    Attributes:
        eye: (3,) its position [m], world frame.
        focal: Its focal length [px].
    """

    eye: np.ndarray
    focal: float

    @classmethod
    def from_camera(cls, camera: PinholeCamera, pose: np.ndarray) -> Footprint:
        """Return the footprint of a camera at pose (4, 4), camera to world."""
        return cls(np.array(pose[:3, 3], dtype=float), float(camera.fx))


class Hits(NamedTuple):
    """What N rays hit. Units and frames are those of GBuffer.

    Attributes:
        depth: (N,) float32 [m], inf in the sky.
        normal: (N, 3) float32, camera frame.
        shading_normal: (N, 3) float32, world frame.
        surface: (N,) int32, SKY, GROUND, ROVER or rock n + 1.
        detail: (N, 4) float32. Of ground: number of the stone that is hit, -1 for none (stones without a height are a
            pattern of the ground); height of the fine relief [m]; share of bare bedrock; share of sunlight that stones
            and fine relief let through. Of bodies: -1; stain, as logarithm of brightness; 0; 1. Of the rover: albedo,
            red, green and blue; 1.
    """

    depth: np.ndarray
    normal: np.ndarray
    shading_normal: np.ndarray
    surface: np.ndarray
    detail: np.ndarray


@dataclass(frozen=True)
class GBuffer:
    """Geometry of one view, sampled at the pixel centres.

    Attributes:
        depth: (H, W) float32 [m], z along the optical axis; inf in the sky.
        normal: (H, W, 3) float32 unit normal of the visible surface, camera frame, facing the camera; 0 in the sky.
        shading_normal: (H, W, 3) float32 normal interpolated over the mesh, world frame, for shading only; 0 in the
            sky.
        surface: (H, W) int32 id: SKY, GROUND, ROVER or rock n + 1.
        detail: (H, W, 4) float32, see Hits.
    """

    depth: np.ndarray
    normal: np.ndarray
    shading_normal: np.ndarray
    surface: np.ndarray
    detail: np.ndarray

    @classmethod
    def of_hits(cls, hits: Hits, shape: tuple[int, int]) -> GBuffer:
        """Return the G-buffer of an image of `shape` (H, W) whose pixels, row by row, hit `hits`."""
        return cls(*(each.reshape(*shape, *each.shape[1:]) for each in hits))

    @property
    def hit(self) -> np.ndarray:
        """(H, W) bool: the pixels that show a surface, not the sky."""
        return self.surface != SKY

    @property
    def pixels(self) -> Hits:
        """What the rays through the pixel centres hit, row by row."""
        return Hits(
            self.depth.ravel(), self.normal.reshape(-1, 3), self.shading_normal.reshape(-1, 3), self.surface.ravel(),
            self.detail.reshape(-1, 4),
        )  # fmt: skip

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
