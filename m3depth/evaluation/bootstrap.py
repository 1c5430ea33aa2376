"""How far a mean over a sample would move with another sample (Efron's bootstrap)."""

from __future__ import annotations

from collections.abc import Hashable, Sequence

import numpy as np

DRAWS = 4000  # resampled means that an interval comes from
COVERAGE = 0.95  # share of the resampled means that an interval holds


def resampled_means(
    values: np.ndarray, clusters: Sequence[Hashable] | None = None, draws: int = DRAWS, seed: int = 0
) -> np.ndarray:
    """Return means over `draws` samples of as many rows as there are, drawn with replacement.

    Args:
        values: (N, ...), one row an image or a drive. A row is drawn as a whole, so that columns of the same images by
            several methods are compared in pairs.
        clusters: (N,) what each row belongs to, as images belong to a scene. Rows of one cluster resemble each other
            and are drawn together, as many clusters as there are (a cluster bootstrap). None: each row by itself.
        draws: Number of samples.
        seed: Seed of the draws.

    Returns:
        (draws, ...) means.
    """
    total, size = values, np.ones(len(values))
    if clusters is not None:
        number = {name: i for i, name in enumerate(dict.fromkeys(clusters))}
        member = np.array([number[name] for name in clusters])
        total, size = np.zeros((len(number), *values.shape[1:])), np.bincount(member).astype(float)
        np.add.at(total, member, values)
    picks = np.random.default_rng(seed).integers(0, len(total), (draws, len(total)))
    rows = size[picks].sum(axis=1)
    return total[picks].sum(axis=1) / rows.reshape(-1, *[1] * (values.ndim - 1))


def interval(statistic: np.ndarray) -> tuple[float, float]:
    """Return the bounds of the middle 95 % of a resampled statistic, (draws,)."""
    low, high = np.quantile(statistic, [(1 - COVERAGE) / 2, (1 + COVERAGE) / 2])
    return float(low), float(high)
