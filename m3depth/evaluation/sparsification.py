"""Does the confidence know where the errors are? The error that remains as the least confident pixels are dropped.

A sparsification curve (Ilg et al. 2018, Sec. 5), over all scored pixels of all images together; beside it the oracle's,
which drops the pixels with the largest error first: nothing can lie below it. Pixels of equal confidence are dropped in
equal shares, so that a method that tells nothing has a flat curve. Memory is that of two histograms.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

DROPPED = np.arange(0, 100, 5) / 100  # shares of the pixels
LOGIT = 16.0  # confidences beyond 1 / (1 + exp(-+16)) are all one
BINS = 3200
SMALLEST, LARGEST = 1e-4, 1e4  # [px] of the oracle's error histogram


class ConfidenceTally:
    """Errors by confidence, and by error, of many images."""

    def __init__(self) -> None:
        self.pixels = np.zeros(BINS)
        self.error = np.zeros(BINS)
        self.bad = np.zeros(BINS)
        self.by_error = np.zeros((2, BINS))  # pixels and their error, by error

    def add(self, confidence: np.ndarray, error: np.ndarray) -> None:
        """confidence: (N,) in [0, 1], NaN counts as 0; error: (N,) [px], finite."""
        sure = np.clip(np.nan_to_num(confidence.astype(np.float64), nan=0.0), 0, 1)
        with np.errstate(divide="ignore"):
            logit = np.clip(np.log(sure) - np.log1p(-sure), -LOGIT, LOGIT)
        index = np.minimum(((logit + LOGIT) * (BINS / (2 * LOGIT))).astype(np.int64), BINS - 1)
        self.pixels += np.bincount(index, minlength=BINS)
        self.error += np.bincount(index, error, BINS)
        self.bad += np.bincount(index, error > 1, BINS)
        scale = BINS / np.log(LARGEST / SMALLEST)
        rank = np.log(np.clip(error, SMALLEST, 0.999 * LARGEST) / SMALLEST) * scale
        size = rank.astype(np.int64)
        self.by_error += [np.bincount(size, minlength=BINS), np.bincount(size, error, BINS)]

    def state_dict(self) -> dict[str, Any]:
        """As m3depth.evaluation.running_sums.Tally.state_dict."""
        return {"pixels": self.pixels, "error": self.error, "bad": self.bad, "by_error": self.by_error}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """As m3depth.evaluation.running_sums.Tally.load_state_dict."""
        self.pixels, self.error, self.bad = state["pixels"], state["error"], state["bad"]
        self.by_error = state["by_error"]

    def result(self) -> dict[str, Any]:
        """{} without pixels, or if all have one confidence. Else

        dropped: shares; epe [px], bad1: of the pixels that are left; oracle_epe, oracle_bad1: the least that any order
        leaves; ause_epe, ause_bad1: mean distance of the two curves, in units of the error at 0; bad1_without_10: the
        share over 1 px without the 10 % least confident pixels, as a part of that over all.
        """
        count = self.pixels.sum()
        if count == 0 or np.count_nonzero(self.pixels) < 2:
            return {}
        bad = self.bad.sum()
        epe = _left(self.pixels, self.error)
        bad1 = _left(self.pixels, self.bad)
        sizes, errors = self.by_error[:, ::-1]
        oracle_epe = _left(sizes, errors)
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


def _left(pixels: np.ndarray, value: np.ndarray) -> np.ndarray:
    """Mean of `value` over what is left after each share of DROPPED, the first bins dropped first."""
    gone = np.concatenate([[0], np.cumsum(pixels)])
    lost = np.concatenate([[0], np.cumsum(value)])
    wanted = DROPPED * gone[-1]
    keep = np.concatenate([[True], np.diff(gone) > 0])
    return (lost[-1] - np.interp(wanted, gone[keep], lost[keep])) / (gone[-1] - wanted)
