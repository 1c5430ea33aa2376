"""How well the confidence marks the errors: the error that remains as the least confident pixels are dropped.

This is a sparsification curve (Ilg et al. 2018, Sec. 5) over all scored pixels of all images together. The oracle's
curve drops the pixels with the largest error first, so nothing can lie below it. Pixels of equal confidence are dropped
in equal shares: a method whose confidence is constant has a flat curve. Memory is that of two histograms.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

DROPPED = np.arange(0, 100, 5) / 100  # shares of the pixels that are dropped
LOGIT = 16.0  # confidences beyond 1 / (1 + exp(-+16)) share a bin
BINS = 3200  # of each histogram
SMALLEST, LARGEST = 1e-4, 1e4  # [px] errors at the ends of the oracle's histogram


class ConfidenceHistograms:
    """Errors of many images by confidence, and by their size.

    Attributes:
        pixels: (BINS,) number of pixels by confidence.
        error: (BINS,) sum of their errors [px].
        bad: (BINS,) number of those off by more than 1 px.
        by_error: (2, BINS) number of pixels by the size of their error, and the sum of these errors [px].
    """

    def __init__(self) -> None:
        self.pixels = np.zeros(BINS)
        self.error = np.zeros(BINS)
        self.bad = np.zeros(BINS)
        self.by_error = np.zeros((2, BINS))

    def add(self, confidence: np.ndarray, error: np.ndarray) -> None:
        """Add pixels.

        Args:
            confidence: (N,) in [0, 1]; NaN counts as 0.
            error: (N,) [px], finite.
        """
        clipped = np.clip(np.nan_to_num(confidence.astype(np.float64), nan=0.0), 0, 1)
        with np.errstate(divide="ignore"):
            logit = np.clip(np.log(clipped) - np.log1p(-clipped), -LOGIT, LOGIT)
        index = np.minimum(((logit + LOGIT) * (BINS / (2 * LOGIT))).astype(np.int64), BINS - 1)
        self.pixels += np.bincount(index, minlength=BINS)
        self.error += np.bincount(index, error, BINS)
        self.bad += np.bincount(index, error > 1, BINS)
        scale = BINS / np.log(LARGEST / SMALLEST)
        rank = np.log(np.clip(error, SMALLEST, 0.999 * LARGEST) / SMALLEST) * scale
        size = rank.astype(np.int64)
        self.by_error += [np.bincount(size, minlength=BINS), np.bincount(size, error, BINS)]

    def state_dict(self) -> dict[str, Any]:
        """Return the state, as RunningSums.state_dict does."""
        return {"pixels": self.pixels, "error": self.error, "bad": self.bad, "by_error": self.by_error}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from a state, as RunningSums.load_state_dict does."""
        self.pixels, self.error, self.bad = state["pixels"], state["error"], state["bad"]
        self.by_error = state["by_error"]

    def result(self) -> dict[str, Any]:
        """Return the curves.

        Returns:
            {} without pixels, or if all have one confidence. Otherwise

            - dropped: shares of the pixels that are dropped.
            - epe [px], bad1: errors of the pixels that are left.
            - oracle_epe, oracle_bad1: the least that any order leaves.
            - ause_epe, ause_bad1: mean distance of the two curves, in units of the error at 0.
            - bad1_without_10: bad1 without the 10 % least confident pixels, as a share of that over all.
        """
        count = self.pixels.sum()
        if count == 0 or np.count_nonzero(self.pixels) < 2:
            return {}
        bad = self.bad.sum()
        epe = _mean_of_rest(self.pixels, self.error)
        bad1 = _mean_of_rest(self.pixels, self.bad)
        sizes, errors = self.by_error[:, ::-1]
        oracle_epe = _mean_of_rest(sizes, errors)
        oracle_bad1 = np.maximum(bad - DROPPED * count, 0) / ((1 - DROPPED) * count)
        tenth = int(np.argmin(np.abs(DROPPED - 0.1)))

        def apart(curve: np.ndarray, oracle: np.ndarray) -> float:
            return float((curve - oracle).mean() / curve[0]) if curve[0] > 0 else 0.0

        return {
            "dropped": DROPPED.tolist(),
            "epe": epe.tolist(),
            "oracle_epe": oracle_epe.tolist(),
            "bad1": bad1.tolist(),
            "oracle_bad1": oracle_bad1.tolist(),
            "ause_epe": apart(epe, oracle_epe),
            "ause_bad1": apart(bad1, oracle_bad1),
            "bad1_without_10": float(bad1[tenth] / bad1[0]) if bad1[0] > 0 else None,
        }


def _mean_of_rest(pixels: np.ndarray, value: np.ndarray) -> np.ndarray:
    """Return the mean of `value` over what is left after each share of DROPPED; the first bins are dropped first."""
    pixels_so_far = np.concatenate([[0], np.cumsum(pixels)])
    value_so_far = np.concatenate([[0], np.cumsum(value)])
    dropped = DROPPED * pixels_so_far[-1]
    keep = np.concatenate([[True], np.diff(pixels_so_far) > 0])
    dropped_value = np.interp(dropped, pixels_so_far[keep], value_so_far[keep])
    return (value_so_far[-1] - dropped_value) / (pixels_so_far[-1] - dropped)
