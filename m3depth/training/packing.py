"""Samples as training keeps them: in less than half of their memory."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from m3depth.stereo.pairs import MAX_DISPARITY
from marssim.base.camera import NATECAM

FARTHEST = 40.0  # [m] trained although only 15 m are scored: what is farther tells far ground from sky
LEAST_DISPARITY = NATECAM.fb / FARTHEST  # [px] that is 4 px; rigs that see more at 40 m are trained as far as that
DISPARITY_UNIT = 1 / 256  # [px] of the packed disparities
TRAINED, SKY, ROCK, SCORED = 1, 2, 4, 8  # flags


class PackedSample(NamedTuple):
    """A sample in three eighths of its memory, 3.1 MB at 512 x 512.

    left, right: (H, W, 3) uint8. disparity: (H, W) uint16, in DISPARITY_UNIT. normal: (H, W, 3) int8, 127 is 1.
    flags: (H, W) uint8, the sum of TRAINED, SKY, ROCK and SCORED where they hold. camera: fx, fy, cx, cy.
    """

    left: np.ndarray
    right: np.ndarray
    disparity: np.ndarray
    normal: np.ndarray
    flags: np.ndarray
    camera: tuple[float, float, float, float]

    @property
    def nbytes(self) -> int:
        return sum(a.nbytes for a in self[:5])


def pack(sample: Any) -> PackedSample:
    """Pack a sample of marssim.base.dataset.dataset, or any object with its fields.

    Depth that is infinite is sky; what is NaN is unknown and not trained. A normal of length 0 is unknown: depth is
    trained there alone.
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
    # What lies beyond FARTHEST is neither trained nor sky; its disparity is kept for the edges.
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
