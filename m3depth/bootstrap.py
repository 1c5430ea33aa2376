"""How far a mean over a sample would move with another sample."""

from __future__ import annotations

import numpy as np

DRAWS = 4000
COVERAGE = 0.95  # of the intervals that are reported


def resampled_means(values: np.ndarray, draws: int = DRAWS, seed: int = 0) -> np.ndarray:
    """Means over `draws` samples of as many rows, drawn with replacement (Efron's bootstrap).

    values: (N, ...), one row an image or drive. What stands in one row is drawn together: columns of the same images
    by several methods are compared in pairs. Returns (draws, ...).
    """
    picks = np.random.default_rng(seed).integers(0, len(values), (draws, len(values)))
    return values[picks].mean(axis=1)


def interval(statistic: np.ndarray) -> tuple[float, float]:
    """The middle 95 % of a resampled statistic, (draws,)."""
    low, high = np.quantile(statistic, [(1 - COVERAGE) / 2, (1 + COVERAGE) / 2])
    return float(low), float(high)
