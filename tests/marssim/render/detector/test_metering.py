import numpy as np
import pytest

from marssim.render.detector.metering import metered_gain


def test_gain_brings_the_grounds_median_to_the_exposure():
    radiance = np.random.default_rng(0).uniform(0.8, 1.2, (31, 41, 1)) * np.ones(3)
    gain = metered_gain(radiance.astype(np.float32), np.ones((31, 41), bool), 0.5)
    assert np.median(gain * radiance) == pytest.approx(0.5**2.2, rel=0.01)


def test_the_brightness_of_a_coloured_pixel_is_the_mean_of_its_channels():
    radiance = np.full((20, 30, 3), [2.0, 0.8, 0.2], np.float32)
    assert metered_gain(radiance, np.ones((20, 30), bool), 0.5) == pytest.approx(0.5**2.2, rel=1e-5)


@pytest.mark.parametrize(("share", "is_kept"), [(0.01, False), (0.04, True)])
def test_the_brightest_two_percent_of_the_ground_may_saturate(share, is_kept):
    radiance = np.full((50, 50, 3), 0.1, np.float32)
    radiance.reshape(-1, 3)[: round(share * 2500)] = 4.0
    gain = metered_gain(radiance, np.ones((50, 50), bool), 0.5)
    assert gain == pytest.approx(0.9 / 4 if is_kept else 0.5**2.2 / 0.1, rel=1e-5)
