"""The form in which training keeps samples in memory, in less than half of their size."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from m3depth.stereo.pairs import MAX_DISPARITY
from marssim.base.camera import NATECAM

FARTHEST = 40.0  # [m] pixels up to here are trained, though only 15 m are scored: far ground is not sky
LEAST_DISPARITY = NATECAM.fb / FARTHEST  # [px] 4 px; rigs with more at 40 m are trained down to it
DISPARITY_UNIT = 1 / 256  # [px] unit of the packed disparities
TRAINED, SKY, ROCK, SCORED = 1, 2, 4, 8  # flags of a pixel


class PackedSample(NamedTuple):
    """A sample in three eighths of its memory, 3.1 MB at 512 x 512.

    Attributes:
        left, right: (H, W, 3) uint8.
        disparity: (H, W) uint16, in DISPARITY_UNIT.
        normal: (H, W, 3) int8; 127 stands for 1.
        flags: (H, W) uint8, the sum of those of TRAINED, SKY, ROCK and SCORED that apply.
        camera: fx, fy, cx, cy [px].
    """

    left: np.ndarray
    right: np.ndarray
    disparity: np.ndarray
    normal: np.ndarray
    flags: np.ndarray
    camera: tuple[float, float, float, float]

    @property
    def nbytes(self) -> int:
        """Memory of the arrays [bytes]."""
        return sum(a.nbytes for a in self[:5])


def pack(sample: Any) -> PackedSample:
    """Pack a StereoSample, or any object with its fields.

    Infinite depth is sky; NaN is unknown and not trained. A normal of length 0 is unknown: only depth is trained there.
    """
    disparity = np.asarray(sample.disparity, np.float32)
    depth = np.asarray(sample.depth)
    sky = np.isposinf(depth)
    near = (depth < FARTHEST) | (disparity > LEAST_DISPARITY)
    trained = near & (depth > 0) & (disparity > 0) & (disparity <= MAX_DISPARITY)
    normal = np.asarray(sample.normal)
    rock = np.asarray(sample.rock) > 0
    scored = trained & np.asarray(sample.valid)
    flags = trained * np.uint8(TRAINED) | sky * np.uint8(SKY) | rock * np.uint8(ROCK) | scored * np.uint8(SCORED)
    # Pixels beyond FARTHEST are neither trained nor sky; their disparity is kept for the edges.
    stored = np.where(np.isfinite(disparity), disparity, 0) / DISPARITY_UNIT
    c = sample.rig.camera
    return PackedSample(
        np.ascontiguousarray(sample.left),
        np.ascontiguousarray(sample.right),
        stored.round().clip(0, 65535).astype(np.uint16),
        (np.nan_to_num(normal) * 127).round().astype(np.int8),
        flags.astype(np.uint8),
        (c.fx, c.fy, c.cx, c.cy),
    )
