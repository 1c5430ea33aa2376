import cv2
import numpy as np
import pytest

from marssim.base.calibration.opencv_file import intrinsics, lens_of


def test_the_skew_in_a_fisheyes_matrix_is_that_of_opencv():
    skew, terms = 0.02, np.array([0.03, -0.01, 0.004, -0.001])
    k = np.array([[400.0, 400 * skew, 310], [0, 420, 240], [0, 0, 1]])
    points = np.random.default_rng(0).uniform([-1, -1, 1], [1, 1, 3], (40, 3))
    zero = np.zeros((3, 1))
    expected = cv2.fisheye.projectPoints(points[:, None], zero, zero, k, terms, alpha=skew)[0][:, 0]
    lens = lens_of(k, terms, True)
    assert lens.project(points) == pytest.approx(expected, abs=1e-6)
    np.testing.assert_allclose(intrinsics(lens)[0], k)
