"""Images that are resampled, and the mask of what they show."""

from functools import partial

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


def test_nothing_is_shown_beyond_the_middles_of_the_outer_pixels():
    image = np.arange(600, dtype=np.uint16).reshape(20, 30)
    for move, column, row in (([0.6, 0.4], 29, 19), ([-0.6, -0.4], 0, 0)):
        shown = resample(image, np.ones(image.shape, bool), partial(np.add, move), (30, 20))[1]
        expected = np.ones((20, 30), bool)
        expected[:, column], expected[row] = False, False
        assert np.array_equal(shown, expected)


@pytest.mark.parametrize(("period", "least", "most"), [(32, 0.88, 0.97), (5, 0.0, 0.1)])
def test_a_reduced_image_keeps_what_its_pixels_can_show_and_aliases_nothing(period, least, most):
    wave = np.round(30_000 + 10_000 * np.sin(2 * np.pi * np.arange(256) / period))
    image = np.tile(wave.astype(np.uint16), (256, 1))
    shown = resample(image, np.ones(image.shape, bool), lambda pixels: 4 * pixels + 1.5, (64, 64), 4.0)[0]
    contrast = np.ptp(shown[32, 16:48].astype(float)) / 20_000
    assert least < contrast < most


def test_resampled_values_are_rounded():
    image = np.tile(np.arange(0, 240, 3, dtype=np.uint8), (40, 1))
    shown, where = resample(image, np.ones(image.shape, bool), partial(np.add, [0.25, 0.5]), (80, 40))
    inner = np.s_[10:-10, 10:-10]
    error = shown[inner].astype(float) - (image[inner] + 0.75)
    assert where[inner].all() and abs(error.mean()) < 0.3 and np.abs(error).max() < 0.6
