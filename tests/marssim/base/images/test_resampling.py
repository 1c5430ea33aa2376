"""Images that are resampled, and the mask of what they show."""

import numpy as np
import pytest

from marssim.base.images.resampling import resample


@pytest.mark.parametrize("step", [0.3, 0.5, 1.7, 3.0])
@pytest.mark.parametrize("reduction", [1.0, 2.0, 4.0])
def test_pixels_that_count_as_shown_draw_nothing_from_those_without_data(step, reduction):
    """A level image with a part without data, which is 0 there, is level wherever the mask says that it is shown."""
    pixels, valid = np.full((60, 160), 20000, np.uint16), np.ones((60, 160), bool)
    valid[:, :40] = valid[30:34, 100:104] = False
    pixels[~valid] = 0
    size = int(160 / max(step, 1)), int(60 / max(step, 1))

    def source(places):
        return places * max(step, 1) + step

    image, shown = resample(pixels, valid, source, size, reduction)
    assert np.abs(image[shown].astype(int) - 20000).max() < 0.01 * 20000
    assert not image[~shown].any() and 0.2 * shown.size < np.count_nonzero(shown) < 0.8 * shown.size
