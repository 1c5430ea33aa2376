"""Weighted least squares that outliers do not sway."""

import numpy as np
import pytest

from m3depth.stereo.robust_fit import weighted_fit


def test_the_covariance_is_that_of_least_squares_with_dependent_neighbours():
    rng = np.random.default_rng(0)
    terms = np.column_stack([np.ones(2000), rng.uniform(-1, 1, 2000)])
    _, covariance = weighted_fit(terms, rng.normal(0, 0.3, 2000))
    assert np.sqrt(covariance[0, 0]) == pytest.approx(2 * 0.3 / np.sqrt(2000), rel=0.15)
