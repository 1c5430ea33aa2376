import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import t as student

from envs.comparison.jackknife import jackknife_interval


@given(st.integers(4, 30), st.integers(0, 99))
def test_that_of_a_mean_is_students(number: int, seed: int) -> None:
    values = np.random.default_rng(seed).normal(size=number)
    without = (values.sum() - values) / (number - 1)
    theirs = student.interval(0.95, number - 1, values.mean(), values.std(ddof=1) / number**0.5)
    assert jackknife_interval(values.mean(), [without], False) == pytest.approx(theirs)
    twice = jackknife_interval(values.mean(), [without, without], False)
    assert np.diff(twice) == pytest.approx(2**0.5 * np.diff(theirs))  # the variances of both kinds are added


def test_that_of_a_correlation_lies_within_its_bounds() -> None:
    without = np.array([0.5, 0.9, 0.99, 0.7])
    low, high = jackknife_interval(0.9, [without], True)
    assert -1 < low < 0.9 < high < 1
    z = np.arctanh([low, 0.9, high])
    assert z[2] - z[1] == pytest.approx(z[1] - z[0])


@pytest.mark.parametrize("without", [[0.1, 0.2, 0.3], [0.1, 0.2, 0.3, np.nan], [0.1, 0.2, 0.3, 1.0]])
def test_few_clusters_and_values_without_a_spread_have_no_interval(without: list[float]) -> None:
    assert jackknife_interval(0.2, [np.array(without), np.linspace(0.1, 0.3, 8)], True) is None
