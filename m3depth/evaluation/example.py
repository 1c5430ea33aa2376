"""One pair for the figures, with what every method predicted for it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from m3depth.evaluation.metrics import StereoTruth, pixel_kinds
from m3depth.stereo.pairs import MAX_DISPARITY
from m3depth.stereo.prediction import Prediction


@dataclass(frozen=True)
class Example:
    """A scored pair.

    Attributes:
        index: Its place in the split.
        left: (H, W, 3) uint8 left image, as the methods received it.
        right: The right image, likewise.
        truth: The ground truth.
        predictions: What each method predicted, by its column's name.
        name: The dataset's name of the pair, for the figures; empty: its place.
        max_disparity: Pixels of a larger true disparity [px] are not scored.
    """

    index: int
    left: np.ndarray
    right: np.ndarray
    truth: StereoTruth
    predictions: dict[str, Prediction]
    name: str = ""
    max_disparity: float = MAX_DISPARITY

    @property
    def title(self) -> str:
        """What figures call the pair."""
        return self.name or f"pair {self.index}"

    @property
    def scored(self) -> np.ndarray:
        """The scored pixels, (H, W) bool."""
        return pixel_kinds(self.truth, self.max_disparity)["all"]
