"""How far a mean over a sample would move with another sample: Efron's bootstrap, and intervals."""

from __future__ import annotations

from collections.abc import Hashable, Sequence

import numpy as np
from scipy.special import ndtri, stdtrit

DRAWS = 4000  # resampled means that an interval comes from
COVERAGE = 0.95  # of intervals
FEWEST_CLUSTERS = 4  # that an interval needs


def resampled_means(values: np.ndarray, clusters: Sequence[Hashable] | None = None, draws: int = DRAWS) -> np.ndarray:
    """Return means over `draws` samples of as many rows as there are, drawn with replacement.

    Args:
        values: (N, ...), one row an image or a drive. A row is drawn as a whole, so that columns of the same images by
            several methods are compared in pairs.
        clusters: (N,) what each row belongs to, as images belong to a scene. Rows of one cluster resemble each other
            and are drawn together, as many clusters as there are (a cluster bootstrap). None: each row by itself.
        draws: Number of samples.

    Returns:
        (draws, ...) means.
    """
    total, size = values, np.ones(len(values))
    if clusters is not None:
        number = {name: i for i, name in enumerate(dict.fromkeys(clusters))}
        member = np.array([number[name] for name in clusters])
        total, size = np.zeros((len(number), *values.shape[1:])), np.bincount(member).astype(float)
        np.add.at(total, member, values)
    picks = np.random.default_rng(0).integers(0, len(total), (draws, len(total)))
    rows = size[picks].sum(axis=1)
    return total[picks].sum(axis=1) / rows.reshape(-1, *[1] * (values.ndim - 1))


def interval(
    resampled: np.ndarray, estimate: float, clusters: int, within: tuple[float, float] = (-np.inf, np.inf)
) -> list[float] | None:
    """Return the 95 % interval of a statistic by the bootstrap.

    The middle 95 % of the resampled values are too narrow an interval with few clusters: they spread by the deviation
    of the sample with n instead of n - 1, and have the tails of the normal distribution instead of Student's
    (Hesterberg 2015, "What teachers should know about the bootstrap"). So both ends are moved away from the estimate by
    the factor sqrt(n / (n - 1)) t / z, with n - 1 degrees of freedom: 1.87 for 4 clusters, 1.10 for 20.

    Args:
        resampled: (draws,) the statistic of each sample, as of resampled_means.
        estimate: The statistic of the data.
        clusters: Number of clusters that the samples were drawn from.
        within: Least and greatest value that the statistic can have.

    Returns:
        Its bounds; None with fewer than FEWEST_CLUSTERS clusters, or where samples have no such statistic (NaN or
        infinite).
    """
    if clusters < FEWEST_CLUSTERS or not np.isfinite(resampled).all():
        return None
    ends = np.quantile(resampled, [(1 - COVERAGE) / 2, (1 + COVERAGE) / 2])
    factor = np.sqrt(clusters / (clusters - 1)) * student_over_normal(clusters)
    low, high = np.clip(estimate + factor * (ends - estimate), *within)
    return [float(low), float(high)]


def mean_interval(
    values: np.ndarray, clusters: Sequence[Hashable], within: tuple[float, float]
) -> tuple[float | None, list[float] | None]:
    """Return the mean of the values that are finite, and its 95 % interval by the bootstrap over clusters.

    Args:
        values: (N,) one of each image or drive.
        clusters: (N,) what each of them belongs to; see resampled_means.
        within: Least and greatest value that the mean can have.

    Returns:
        None for both if no value is finite; None for the interval with fewer than FEWEST_CLUSTERS clusters.
    """
    finite = np.isfinite(values)
    if not finite.any():
        return None, None
    chosen, of_chosen = values[finite], [cluster for cluster, is_finite in zip(clusters, finite) if is_finite]
    mean = float(chosen.mean())
    return mean, interval(resampled_means(chosen, of_chosen), mean, len(set(of_chosen)), within)


def student_interval(values: np.ndarray) -> list[float] | None:
    """Return Student's 95 % interval of the mean of values (n,); None for fewer than two, or if one is not finite."""
    if len(values) < 2 or not np.isfinite(values).all():
        return None
    reach = stdtrit(len(values) - 1, (1 + COVERAGE) / 2) * values.std(ddof=1) / np.sqrt(len(values))
    return [float(values.mean() - reach), float(values.mean() + reach)]


def student_over_normal(clusters: int) -> float:
    """Return the quantile t of Student's distribution for the mean of n clusters over that of the normal one, z."""
    upper = (1 + COVERAGE) / 2
    return float(stdtrit(max(clusters - 1, 1), upper) / ndtri(upper))
