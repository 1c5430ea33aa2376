"""Figures of how far the rows of matched points lie apart."""

import numpy as np
import pytest

from m3depth.rectification.row_errors import RowCorrection, row_errors


def test_the_distances_of_rows_are_reported_by_their_median_and_their_95th_percentile() -> None:
    left, right = np.zeros((101, 2)), np.zeros((101, 2))
    left[:, 0], left[:, 1] = 7, np.arange(101)  # the right point lies above the left one
    errors = row_errors(left, right)
    assert (errors.points, errors.median, errors.most, errors.offset) == (101, 50, pytest.approx(95), -50)


@pytest.mark.parametrize(
    ("size", "error", "taken_out"),
    [(0.3, 0.02, True), (0.3, 0.2, False), (0.015, 0.001, False), (0.03, 0.001, True), (0.03, 0.02, False)],
)
def test_a_correction_must_be_no_accident_and_matter(size, error, taken_out) -> None:
    """At least three standard errors, and 0.02 px."""
    assert RowCorrection((size,), error, size, (0.0, 0.0), 100.0).significant == taken_out
