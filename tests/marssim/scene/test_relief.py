import numpy as np
import pytest
from scipy import fft

from marssim.scene.relief import long_waves, self_affine


@pytest.mark.parametrize("hurst", [0.5, 0.7, 0.8])
def test_height_differences_grow_as_the_hurst_exponent_says(hurst):
    """E[(h(x + r) - h(x))^2] = s^2 r^2H from four cells of the grid to half of its side."""
    n, slope = 128, 0.09
    x = np.arange(n, dtype=float)
    lags = np.array([4, 8, 16, 32, 64])
    spread = np.zeros(len(lags))
    for seed in range(160):
        rng = np.random.default_rng(seed)
        h = fft.irfft2(self_affine(n, 1.0, hurst, slope, rng), s=(n, n)) + long_waves(x, n, hurst, slope, rng)
        spread += [np.mean((h[:, lag:] - h[:, :-lag]) ** 2) / 160 for lag in lags]
    assert np.sqrt(spread) == pytest.approx(slope * lags**hurst, rel=0.05)


def test_waves_of_a_side_alone_are_too_level():
    """Without long_waves, a tenth to a third of the height differences is lost."""
    n, hurst, slope, lag = 128, 0.8, 0.09, 32
    spread = 0.0
    for seed in range(60):
        h = fft.irfft2(self_affine(n, 1.0, hurst, slope, np.random.default_rng(seed)), s=(n, n))
        spread += np.mean((h[:, lag:] - h[:, :-lag]) ** 2) / 60
    assert np.sqrt(spread) < 0.85 * slope * lag**hurst
