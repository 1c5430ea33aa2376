import cv2
import numpy as np

from m3depth.stereo.row_matches import followed


def test_points_that_do_not_come_back_are_not_trusted():
    rng = np.random.default_rng(0)
    left, right = (cv2.GaussianBlur(rng.integers(0, 256, (128, 128), dtype=np.uint8), (0, 0), 1.5) for _ in range(2))
    u, v = np.meshgrid(np.arange(16.0, 112, 6), np.arange(16.0, 112, 6))
    places = np.column_stack([u.ravel(), v.ravel()])
    assert followed(left, left, places, places)[1].mean() > 0.95
    assert followed(left, right, places, places)[1].mean() < 0.1  # two places: nothing matches
