"""Figures of how far the rows of matched points lie apart."""

import numpy as np
import pytest

from m3depth.rectification.row_errors import row_errors


def test_the_distances_of_rows_are_reported_by_their_median_and_their_95th_percentile() -> None:
    left, right = np.zeros((101, 2)), np.zeros((101, 2))
    left[:, 0], left[:, 1] = 7, np.arange(101)  # the right point lies above the left one
    errors = row_errors(left, right)
    assert (errors.points, errors.median, errors.most, errors.offset) == (101, 50, pytest.approx(95), -50)
