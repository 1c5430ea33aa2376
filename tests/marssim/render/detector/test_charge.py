import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from marssim.render.detector.charge import bled, in_full_scale, with_smear


def bar() -> np.ndarray:
    signal = np.full((60, 9, 3), 0.4, np.float32)
    signal[28:32, 4] = 3.0
    return signal


@given(st.floats(0, 1))
def test_overflow_fills_the_column_up_and_down_and_no_charge_is_lost(share):
    signal = bar()
    out = bled(signal, share)
    assert out.max() <= 1 and np.array_equal(out[:, :4], signal[:, :4])
    spilled = share * (signal - 1).clip(0).sum()
    assert (out - np.minimum(signal, 1)).sum() == pytest.approx(spilled, abs=1e-3)
    assert np.allclose(out, out[::-1], atol=1e-5)  # the bar is in the middle
    full = (out[:, 4, 0] > 0.999).sum()
    assert full == pytest.approx(4 + share * 8 / 0.6, abs=2.1)


def test_the_overflow_of_one_colour_fills_all():
    signal = np.full((40, 3, 3), 0.5, np.float32)
    signal[20, 1, 0] = 13.0
    out = bled(signal, 1.0)
    assert (out[18:23, 1] > 0.999).all() and (np.ptp(out[:, 1], axis=1) < 1e-5).all()


def test_overflow_beyond_the_border_is_lost():
    signal = bar()
    signal[:, 4] = 5.0
    assert np.array_equal(bled(signal, 1.0)[:, 4], np.ones((60, 3), np.float32))


def test_smear_adds_the_mean_of_the_column():
    smeared = with_smear(bar(), 0.1) - bar()
    assert np.allclose(smeared[:, 0], 0.04) and np.allclose(smeared[:, 4], 0.1 * bar()[:, 4].mean(axis=0))
    assert np.array_equal(with_smear(bar(), 0.0), bar())


def test_the_signal_falls_off_to_the_corners_by_the_vignetting():
    out = in_full_scale(np.ones((41, 61, 3), np.float32), 0.5, 0.3)
    assert out[20, 30] == pytest.approx(0.5) and out[0, 0] == pytest.approx(0.35) and out[-1, -1] == pytest.approx(0.35)
    assert out.dtype == np.float32


def test_saturated_pixels_at_either_end_of_a_column_overflow_inwards():
    top = np.full((20, 3, 3), 0.5, np.float32)
    top[0, 1] = 4.0
    filled, mirrored = bled(top, 1.0), bled(top[::-1], 1.0)[::-1]
    assert np.allclose(filled, mirrored)
    assert (filled - np.minimum(top, 1)).sum() == pytest.approx(4.5)  # the other half runs out of the column
