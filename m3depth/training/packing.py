"""The form in which training keeps samples in memory, in less than half of their size."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from m3depth.network.config import FARTHEST_STEP
from m3depth.stereo.pairs import MAX_DISPARITY, NEAREST
from marssim.base.camera import NATECAM, StereoRig

FARTHEST = 40.0  # [m] pixels up to here are trained, though only 15 m are scored: far ground is not sky
LEAST_DISPARITY = NATECAM.fb / FARTHEST  # [px] 4 px; rigs with more at 40 m are trained down to it
REDUCED = 1.25  # from this many times MAX_DISPARITY on, the cost volume works on reduced pairs
TRAINED, SKY, ROCK, SCORED, ONE_EYE, ROVER = 1, 2, 4, 8, 16, 32  # flags of a pixel


class PackedSample(NamedTuple):
    """A sample in less than half of its memory, 3.7 MB at 512 x 512.

    Attributes:
        left, right: (H, W, 3) uint8.
        disparity: (H, W) float32 [px]; 0 where it is unknown.
        normal: (H, W, 3) int8; 127 stands for 1.
        flags: (H, W) uint8, the sum of those of TRAINED, SKY, ROCK, SCORED, ONE_EYE (the right eye does not see it) and
            ROVER (the rover itself) that apply.
        camera: fx, fy, cx, cy [px].
        baseline: Of the cameras [m].
        reduction: Factor, a power of 2, by which the pair is larger than the one that the cost volume works on.
    """

    left: np.ndarray
    right: np.ndarray
    disparity: np.ndarray
    normal: np.ndarray
    flags: np.ndarray
    camera: tuple[float, float, float, float]
    baseline: float
    reduction: int = 1

    @property
    def nbytes(self) -> int:
        """Memory of the arrays [bytes]."""
        return sum(a.nbytes for a in self[:5])


def reduction_of(rig: StereoRig) -> int:
    """Return the factor by which pairs of a rig are reduced, in training, for the cost volume: 1, 2 or 4.

    It ends at 4, beyond which the network takes two steps; larger disparities are then not trained. Unlike infer, it
    does not regard the images' width, which is less than the disparity of NEAREST for long baselines alone.
    """
    factor = 1
    while factor < FARTHEST_STEP and rig.fb / NEAREST > REDUCED * factor * MAX_DISPARITY:
        factor *= 2
    return factor


def pack(sample: Any) -> PackedSample:
    """Pack a StereoSample, or any object with its fields.

    Infinite depth is sky; NaN is unknown and not trained. A normal of length 0 is unknown: only depth is trained there.
    """
    disparity = np.asarray(sample.disparity, np.float32)
    depth = np.asarray(sample.depth)
    sky = np.isposinf(depth)
    near = (depth < FARTHEST) | (disparity > LEAST_DISPARITY)
    reduction = reduction_of(sample.rig)
    trained = near & (depth > 0) & (disparity > 0) & (disparity <= MAX_DISPARITY * reduction)
    normal = np.asarray(sample.normal)
    rock = np.asarray(sample.rock) > 0
    scored = trained & np.asarray(sample.valid)
    flags = trained * np.uint8(TRAINED) | sky * np.uint8(SKY) | rock * np.uint8(ROCK) | scored * np.uint8(SCORED)
    flags |= np.asarray(sample.occluded) * np.uint8(ONE_EYE) | (np.asarray(sample.rock) < 0) * np.uint8(ROVER)
    # Pixels beyond FARTHEST are neither trained nor sky; their disparity is kept for the edges.
    c = sample.rig.camera
    return PackedSample(
        np.ascontiguousarray(sample.left),
        np.ascontiguousarray(sample.right),
        np.where(np.isfinite(disparity), disparity, np.float32(0)),
        (np.nan_to_num(normal) * 127).round().astype(np.int8),
        flags.astype(np.uint8),
        (c.fx, c.fy, c.cx, c.cy),
        sample.rig.baseline,
        reduction,
    )
