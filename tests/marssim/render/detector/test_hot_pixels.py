import numpy as np
import pytest

from marssim.render.detector.hot_pixels import STRENGTH, with_hot_pixels

DARK = np.full((300, 400, 3), 0.1, np.float32)


def test_hot_pixels_are_as_many_and_as_strong_as_asked_for():
    added = with_hot_pixels(DARK, 2000, 5, 0) - DARK
    hot = added[added[..., 0] > 0]
    assert len(hot) == pytest.approx(240, abs=50) and added.min() >= 0
    assert hot.mean() == pytest.approx(STRENGTH, rel=0.25)
    assert np.array_equal(hot[:, 0], hot[:, 2])


def test_each_eye_has_its_own_hot_pixels_and_keeps_them():
    left, same, right = (with_hot_pixels(DARK, 1000, 5, eye) for eye in (0, 0, 1))
    assert np.array_equal(left, same)
    assert not ((left > DARK) & (right > DARK)).all(axis=-1).sum() > 3
    assert np.array_equal(with_hot_pixels(DARK, 0, 5, 0), DARK)
