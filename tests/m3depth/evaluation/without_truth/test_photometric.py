import cv2
import numpy as np
import pytest

from m3depth.evaluation.without_truth.photometric import normalised, residuals


def shifted(disparity: int) -> tuple[np.ndarray, np.ndarray]:
    wall = cv2.GaussianBlur(np.random.default_rng(0).standard_normal((60, 120)).astype(np.float32), (0, 0), 1.5)
    wall = cv2.normalize(wall, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
    return wall[:, :100], wall[:, disparity : disparity + 100]


def test_the_true_disparity_explains_the_image_and_each_half_pixel_less():
    left, right = shifted(8)
    means = [
        float(np.nanmean(residuals(left, right, np.full(left.shape, d, np.float32)))) for d in (8.0, 8.5, 9.0, 12.0)
    ]
    assert means[0] < 0.05 and means[0] < means[1] < means[2] < means[3]


def test_a_change_of_brightness_and_contrast_is_no_residual():
    left, right = shifted(8)
    darker = np.round(right * 0.5 + 20).astype(np.uint8)
    disparity = np.full(left.shape, 8, np.float32)
    assert float(np.nanmean(residuals(left, darker, disparity))) < 0.1
    assert normalised(left).std() == pytest.approx(1, abs=0.15)


def test_unknown_pixels_and_the_border_do_not_count():
    left, right = shifted(8)
    disparity = np.full(left.shape, 8, np.float32)
    disparity[30, 50] = np.nan
    out = residuals(left, right, disparity)
    assert np.isnan(out[30, 50]) and np.isnan(out[:2]).all() and np.isnan(out[:, :10]).all()
    assert np.isfinite(out[5:25, 12:95]).all()
