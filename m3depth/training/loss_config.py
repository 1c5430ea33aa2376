"""Weights of the loss terms. This file loads no torch, so that the commands print their help at once."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass


@dataclass(frozen=True)
class LossConfig:
    """Weights of the loss terms. A weight of 0 removes its term from the sum.

    Raises:
        ValueError: A weight is negative or not finite; the message names its flag.
    """

    disparity: float = 2.0
    """Weight of the disparity error, lambda_d of the paper."""
    normal: float = 1.0
    """Weight of the error of the normals, lambda_n of the paper."""
    consistency: float = 3.0
    """Weight of the consistency of disparity and normals, lambda_c of the paper."""
    relative: float = 4.0
    """Weight of the relative error beside the error in pixels: with 4, disparities of 4 px count double."""
    decay: float = 0.8
    """Weight of each refinement step relative to the next one."""
    initial: float = 1.0
    """Weight of the first maps, of soft argmin and SNNet."""
    rock: float = 4.0
    """Weight of pixels on rocks, their outlines included."""
    edge: float = 3.0
    """Weight of the other pixels at disparity edges."""
    sky_disparity: float = 0.02
    """Weight that pulls the disparity of sky pixels to zero; small, as sky is decided apart."""
    confidence: float = 0.2
    """Weight of the cross-entropy of the decision "within 1 px"."""
    sky: float = 0.3
    """Weight of the cross-entropy of the decision "sky or too far to measure"."""

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if not (math.isfinite(value) and value >= 0):
                raise ValueError(f"--loss.{name.replace('_', '-')} must be at least 0, got {value}")
