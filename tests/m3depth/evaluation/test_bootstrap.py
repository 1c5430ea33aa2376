import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import bootstrap

from m3depth.evaluation.bootstrap import interval, resampled_means


@given(st.integers(0, 99))
def test_intervals_are_scipys_percentile_bootstrap(seed: int) -> None:
    values = np.random.default_rng(seed).lognormal(size=40)
    theirs = bootstrap((values,), np.mean, n_resamples=4000, method="percentile", rng=seed).confidence_interval
    ours = interval(resampled_means(values))
    np.testing.assert_allclose(ours, theirs, atol=0.15 * (theirs.high - theirs.low))


def test_columns_are_drawn_together() -> None:
    values = np.random.default_rng(0).normal(size=30)
    means = resampled_means(np.stack([values, values + 1], 1))
    assert means.shape == (4000, 2)
    np.testing.assert_allclose(means[:, 1] - means[:, 0], 1)
    assert np.std(means[:, 0]) == pytest.approx(values.std() / 30**0.5, rel=0.05)
    np.testing.assert_allclose(means[:, 0], resampled_means(values), atol=1e-12)


@given(st.integers(0, 99))
def test_rows_of_a_cluster_are_drawn_together(seed: int) -> None:
    rng = np.random.default_rng(seed)
    clusters = rng.integers(0, 12, 60).tolist()
    values = rng.normal(size=(60, 2))
    alike = resampled_means(np.repeat(values[:12], 5, 0), [i for i in range(12) for _ in range(5)])
    np.testing.assert_allclose(alike, resampled_means(values[:12]), atol=1e-12)
    # By hand: the mean over all rows of the clusters drawn.
    names = list(dict.fromkeys(clusters))
    picks = np.random.default_rng(0).integers(0, len(names), (4000, len(names)))
    rows = [np.flatnonzero(np.array(clusters) == names[pick]) for pick in picks[7]]
    np.testing.assert_allclose(resampled_means(values, clusters)[7], values[np.concatenate(rows)].mean(0), atol=1e-12)


def test_an_interval_holds_the_middle_95_percent() -> None:
    assert interval(np.arange(1001) / 10) == pytest.approx((2.5, 97.5))
