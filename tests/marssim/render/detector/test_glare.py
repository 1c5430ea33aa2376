import numpy as np
import pytest
from scipy.stats import norm

from marssim.render.detector.glare import with_glare


def test_glare_keeps_level_light_and_spreads_a_light_around_it():
    level = np.full((64, 80, 3), 0.3, np.float32)
    assert np.allclose(with_glare(level, 0.3), level, atol=1e-5)
    lamp = np.zeros((160, 160, 3), np.float32)
    lamp[72:88, 72:88] = 10
    glare = with_glare(lamp, 0.2)
    assert glare.sum() == pytest.approx(lamp.sum(), rel=0.05)
    row = glare[80, :, 0]
    assert row[80] < 10 and row[95] > row[110] > row[140] > 0
    assert np.array_equal(with_glare(lamp, 0.0), lamp)


@pytest.mark.parametrize("axis", [0, 1])
def test_an_edge_becomes_the_mean_of_three_gaussians_and_goes_on_beyond_the_border(axis):
    """Their widths are shares of the image's width along both axes; the strip goes on beyond the image."""
    sides = (160, 320)
    lamp = np.zeros((*sides, 3), np.float32)
    lamp.swapaxes(0, axis)[:40] = 1
    halo = 2 * with_glare(lamp, 0.5) - lamp
    at = np.arange(sides[axis])
    expected = np.mean([norm.cdf((39.5 - at) / (320 * width)) for width in (0.01, 0.04, 0.16)], axis=0)
    row = halo.swapaxes(0, axis)[:, sides[1 - axis] // 2, 0]
    inside = np.abs(at - 39.5) > 12  # nearer, the coarse image shows
    assert np.abs(row - expected)[inside].max() < 0.02
