"""One pair to show, with what every method made of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from m3depth.evaluation.metrics import StereoTruth
from m3depth.stereo.prediction import Prediction


@dataclass(frozen=True)
class Example:
    """left, right: (H, W, 3) uint8 as the methods saw them; predictions by method."""

    index: int
    left: np.ndarray
    right: np.ndarray
    truth: StereoTruth
    predictions: dict[str, Prediction]
