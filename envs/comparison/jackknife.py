"""Intervals by the jackknife over courses and over conditions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import stdtrit

from m3depth.evaluation.bootstrap import COVERAGE, FEWEST_CLUSTERS


def jackknife_interval(value: float, left_out: Sequence[np.ndarray], is_correlation: bool) -> list[float] | None:
    """Return the 95 % interval of a statistic of data that several kinds of clusters have in common.

    The statistic without each cluster gives its variance by the clusters of a kind (Efron and Stein 1981, "The
    jackknife estimate of variance"). The variances of all kinds are added, which counts the chance that they share
    twice, on the safe side. Student's quantile is that of the kind with the fewest clusters.

    Args:
        value: The statistic of all data.
        left_out: For each kind, (n,) the statistic without each of its n clusters.
        is_correlation: Whether the interval is that of Fisher's z, so that it lies within -1 and 1.

    Returns:
        Its bounds; None with fewer than FEWEST_CLUSTERS of a kind, or where a value is NaN or a correlation of 1.
    """
    fewest = min(map(len, left_out))
    every = np.concatenate([[value], *left_out])
    if fewest < FEWEST_CLUSTERS or not np.isfinite(every).all() or (is_correlation and np.abs(every).max() > 1 - 1e-12):
        return None
    replicates = [np.arctanh(values) if is_correlation else values for values in left_out]
    reach = stdtrit(fewest - 1, (1 + COVERAGE) / 2) * np.sqrt(sum((len(part) - 1) * part.var() for part in replicates))
    if is_correlation:
        return np.tanh(np.arctanh(value) + np.array([-reach, reach])).tolist()
    return [float(value - reach), float(value + reach)]
