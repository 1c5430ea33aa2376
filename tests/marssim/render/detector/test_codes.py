import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from marssim.render.detector.codes import GAMMA, Readout, stretch_limits


def readout(signal: np.ndarray) -> Readout:
    signal = signal.astype(np.float32)
    return Readout(signal, np.zeros_like(signal), 1.0, 0.0, 1e9, 0.0)


@given(st.floats(0, 120), st.floats(130, 255))
def test_a_stretch_is_linear_in_the_code_between_its_limits(low, high):
    signal = np.linspace(0, 1, 3000).reshape(100, 10, 3)
    code = 255 * signal ** (1 / GAMMA)
    expected = np.clip(255 * (code - low) / (high - low), 0, 255)
    assert np.abs(readout(signal).codes((low, high)) - expected).max() <= 0.51
    assert np.abs(readout(signal).codes() - code).max() <= 0.51


@given(st.floats(0.001, 0.1), st.integers(0, 5))
def test_limits_leave_about_the_share_beyond_each_end(share, seed):
    image = np.clip(np.random.default_rng(seed).normal(120, 25, (90, 90, 3)), 0, 255).astype(np.uint8)
    low, high = stretch_limits(image, share)
    assert (image < low).mean() <= share + 1e-9 <= (image <= low).mean() + 1e-6
    assert (image > high).mean() <= share + 1e-9
    stretched = readout((image / 255.0) ** GAMMA).codes((low, high))
    assert (stretched == 0).mean() == pytest.approx(share, abs=0.02)
    assert (stretched == 255).mean() == pytest.approx(share, abs=0.02)


@pytest.mark.parametrize("value", [0, 90, 255])
def test_a_level_image_can_be_stretched(value):
    low, high = stretch_limits(np.full((20, 20, 3), value, np.uint8), 0.01)
    assert 0 <= low < high <= 255


def test_vignetting_reaches_its_share_in_the_corners_of_an_image_of_any_shape():
    signal = np.full((31, 81, 3), 0.5, np.float32)
    codes = readout(signal)._replace(gain=1.5, vignetting=0.4).codes()
    x, y = np.meshgrid(np.linspace(-1, 1, 81), np.linspace(-1, 1, 31))
    expected = 255 * (0.75 * (1 - 0.4 * (x**2 + y**2) / 2)) ** (1 / GAMMA)
    assert np.abs(codes - expected[..., None]).max() <= 0.51
