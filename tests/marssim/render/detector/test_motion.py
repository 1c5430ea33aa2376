import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from marssim.render.detector.motion import moved, path


@given(st.floats(0.1, 20), st.floats(-360, 360))
def test_a_path_has_its_length_and_direction_and_stays_in_the_middle(length, direction):
    weights = path(length, direction)
    at = np.arange(len(weights)) - len(weights) // 2
    assert weights.sum() == pytest.approx(1, abs=1e-5) and weights.min() >= 0
    assert (weights * at).sum() == pytest.approx(0, abs=1e-4)
    assert (weights * at[:, None]).sum() == pytest.approx(0, abs=1e-4)
    angle = np.deg2rad(direction)
    along = at * np.cos(angle) + at[:, None] * np.sin(angle)
    spread = (weights * along**2).sum()
    assert length**2 / 12 * 0.9 <= spread <= length**2 / 12 * 1.25 + 0.27  # pixels are as wide as a quarter px^2
    across = at * np.sin(angle) - at[:, None] * np.cos(angle)
    assert (weights * across**2).sum() < 0.3


def test_motion_along_the_rows_blurs_columns_alone():
    image = np.zeros((21, 21, 3), np.float32)
    image[:, 10] = 1
    assert np.allclose(moved(image, 6, 90), image, atol=1e-6)
    blurred = moved(image, 6, 0)[10, :, 0]
    assert blurred.sum() == pytest.approx(1, abs=1e-5) and (blurred > 0.05).sum() in (6, 7)
