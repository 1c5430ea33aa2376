"""Weights of the loss terms. Without torch, so that the commands explain themselves at once."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass


@dataclass(frozen=True)
class LossConfig:
    """Weights of the loss terms; a weight of 0 takes its term out of the sum.

    Raises ValueError that names the flag of a weight that is negative or not finite.
    """

    disparity: float = 2.0  # lambda_d of the paper
    normal: float = 1.0  # lambda_n
    consistency: float = 3.0  # lambda_c
    relative: float = 4.0  # weight of the relative error beside the error in pixels: 4 px of disparity count double
    decay: float = 0.8  # weight of each refinement step, relative to the next one
    initial: float = 1.0  # weight of soft argmin and SNNet
    rock: float = 4.0  # pixels on rocks count this much, their outlines too
    edge: float = 3.0  # pixels at disparity edges beside them count this much
    sky_disparity: float = 0.02  # pull of sky pixels to zero disparity; small, as sky has a decision of its own
    confidence: float = 0.2  # cross-entropy of "within 1 px"
    sky: float = 0.3  # cross-entropy of "sky or beyond measure"

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if not (math.isfinite(value) and value >= 0):
                raise ValueError(f"--loss.{name.replace('_', '-')} must be at least 0, got {value}")
