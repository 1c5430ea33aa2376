import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from marssim.render.texture import TEXELS, TILE, fractal, noise_tile, octave_weight, sample_octave

WAVELENGTHS = np.array([0.02, 0.1, 0.7])
ONES = np.ones(3)


def places(count: int, seed: int = 0, reach: float = 30.0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-reach, reach, (count, 2)).astype(np.float32)


@pytest.mark.parametrize("count", [1, 7, 511, 512, 513, 3000])
def test_a_point_has_its_value_whatever_is_asked_with_it(count):
    uv = places(3000)
    whole = sample_octave(uv, 0.1, seed=4, octave=2)
    picked = np.random.default_rng(1).permutation(3000)[:count]
    assert np.allclose(sample_octave(uv[picked], 0.1, seed=4, octave=2), whole[picked], atol=1e-6)
    footprint = np.random.default_rng(2).uniform(0.001, 0.4, 3000)
    value, slopes = fractal(uv, footprint, WAVELENGTHS, ONES, ONES, seed=4)
    some, some_slopes = fractal(uv[picked], footprint[picked], WAVELENGTHS, ONES, ONES, seed=4)
    assert np.allclose(some, value[picked], atol=1e-5) and np.allclose(some_slopes, slopes[picked], atol=1e-5)


def test_more_points_than_an_image_may_have_columns():
    uv = places(40_000)
    assert np.array_equal(sample_octave(uv, 0.1, 4, 2)[-5:], sample_octave(uv[-5:], 0.1, 4, 2))


def test_without_slopes_the_value_is_the_same():
    uv, footprint = places(1000), np.full(1000, 0.01)
    assert np.allclose(sample_octave(uv, 0.3, 1, 0, slopes=False)[:, 0], sample_octave(uv, 0.3, 1, 0)[:, 0], atol=1e-6)
    bare, none = fractal(uv, footprint, WAVELENGTHS, ONES, None, seed=1)
    assert none is None
    assert np.allclose(bare, fractal(uv, footprint, WAVELENGTHS, ONES, ONES, seed=1)[0], atol=1e-5)


@given(wavelength=st.floats(0.01, 10), ratio=st.floats(0.001, 5), less=st.floats(0.1, 1))
def test_octaves_fade_out_by_two_pixels(wavelength, ratio, less):
    weight, closer = octave_weight(wavelength, np.array([ratio, ratio * less]) * wavelength)
    assert 0 <= weight <= closer <= 1
    if ratio >= 0.5:
        assert weight == 0
    if ratio <= 1 / 5.5 - 1e-6:
        assert weight == pytest.approx(1, abs=1e-6)


def test_what_a_pixel_cannot_show_is_gone():
    uv = places(2000)
    footprint = np.repeat([0.36, 0.051], 1000)  # the coarsest octave is under two pixels; it alone is not
    value, slopes = fractal(uv, footprint, WAVELENGTHS, ONES, ONES, seed=3)
    assert not value[:1000].any() and not slopes[:1000].any()
    alone = sample_octave(uv[1000:], 0.7, seed=3, octave=2)
    assert np.allclose(value[1000:], alone[:, 0], atol=1e-5) and np.allclose(slopes[1000:], alone[:, 1:], atol=1e-5)


@pytest.mark.parametrize("seed", [0, 2**31 + 1])
def test_unit_variance(seed):
    tile = noise_tile(seed)[:-1, :-1]
    assert np.allclose(tile.std(axis=(0, 1)), 1, atol=1e-3) and np.allclose(tile.mean(axis=(0, 1)), 0, atol=1e-3)
    sampled = sample_octave(places(40_000), 0.1, seed, 1)
    assert np.allclose(sampled.std(axis=0), 1, atol=0.08)  # interpolation takes a little


def test_the_tile_has_no_seam():
    tile = noise_tile(9)
    assert np.array_equal(tile[0], tile[-1]) and np.array_equal(tile[:, 0], tile[:, -1])
    wavelength, step = 0.1, 1 / 16  # of a texel
    period = TILE / TEXELS * wavelength
    along = np.arange(0, 4 * period, step * wavelength / TEXELS)
    uv = np.stack([along, 0.3 * along], axis=1).astype(np.float32)  # crosses borders of the tile both ways
    steps = np.abs(np.diff(sample_octave(uv, wavelength, 9, 0, slopes=False)[:, 0]))
    steepest = np.abs(np.diff(tile[..., 0], axis=0)).max() + np.abs(np.diff(tile[..., 0], axis=1)).max()
    assert steps.max() < 2.2 * step * steepest  # remap's coordinates are rounded to 1 / 32


def test_most_of_the_power_lies_about_the_wavelength():
    wavelength, n, pixel = 0.2, 256, 0.025
    axis = np.arange(n) * pixel
    uv = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2).astype(np.float32)
    field = sample_octave(uv, wavelength, 5, 3)[:, 0].reshape(n, n) * np.hanning(n)[:, None] * np.hanning(n)
    power = np.abs(np.fft.rfft2(field)) ** 2
    octaves = np.log2(np.maximum(np.hypot(np.fft.fftfreq(n)[:, None], np.fft.rfftfreq(n)) / pixel * wavelength, 1e-3))
    assert power[np.abs(octaves) < 1].sum() > 0.9 * power.sum()
    assert abs((octaves * power).sum() / power.sum()) < 0.3


@pytest.mark.parametrize("octave", range(4))  # each is turned by another angle
def test_slopes_are_those_of_the_value(octave):
    uv, wavelength = places(3000), 0.3
    slopes = sample_octave(uv, wavelength, 8, octave)[:, 1:]
    for axis in (0, 1):
        step = np.zeros(2, np.float32)
        step[axis] = wavelength / 8
        values = [sample_octave(uv + sign * step, wavelength, 8, octave, slopes=False)[:, 0] for sign in (1, -1)]
        assert np.corrcoef(values[0] - values[1], slopes[:, axis])[0, 1] > 0.97
        assert abs(np.corrcoef(values[0] - values[1], slopes[:, 1 - axis])[0, 1]) < 0.15


def test_seeds_and_octaves_differ():
    uv = places(4000)
    first = sample_octave(uv, 0.1, 1, 0)[:, 0]
    for seed, octave in ((2, 0), (1, 1)):
        assert abs(np.corrcoef(first, sample_octave(uv, 0.1, seed, octave)[:, 0])[0, 1]) < 0.1
