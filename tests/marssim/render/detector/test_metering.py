import numpy as np
import pytest

from marssim.render.detector.metering import metered_gain


def test_gain_brings_the_grounds_median_to_the_exposure():
    radiance = np.random.default_rng(0).uniform(0.8, 1.2, (31, 41, 1)) * np.ones(3)
    gain = metered_gain(radiance.astype(np.float32), np.ones((31, 41), bool), 0.5)
    assert np.median(gain * radiance) == pytest.approx(0.5**2.2, rel=0.01)
