import numpy as np
import pytest

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
