import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba import njit

from marssim.scene.ground import noise as grain
from marssim.scene.ground.noise import TEXELS, TILE, coded_tile, noise_tile, placing


def kernel(part):
    """Compile a kernel that does nothing but call a part of kernels."""
    return njit(lambda *arguments: part(*arguments))


octave_slopes, octave_value = kernel(grain.octave_slopes), kernel(grain.octave_value)
octave_weight = kernel(grain.octave_weight)
WAVELENGTHS = np.array([0.02, 0.1, 0.7])


def places(count: int, seed: int = 0, reach: float = 30.0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-reach, reach, (count, 2)).astype(np.float32)


def noise(uv: np.ndarray, wavelengths, seed: int, octave: int) -> np.ndarray:
    """(N, 3) value and slopes of one octave at each place."""
    tile, places = coded_tile(seed), placing(tuple(wavelengths), seed)
    return np.array([octave_slopes(tile, places, octave, u, v) for u, v in uv.astype(float)])


def values(uv: np.ndarray, wavelengths, seed: int, octave: int) -> np.ndarray:
    tile, places = coded_tile(seed, False), placing(tuple(wavelengths), seed)
    return np.array([octave_value(tile, places, octave, u, v) for u, v in uv.astype(float)])


def test_without_slopes_the_value_is_the_same():
    uv = places(300)
    assert np.allclose(values(uv, WAVELENGTHS, 1, 2), noise(uv, WAVELENGTHS, 1, 2)[:, 0], atol=1e-5)


def test_interpolation_is_bilinear():
    """At texel centres stands the texel, half way between two of them their mean."""
    place, tile = placing((8.0,), 3), noise_tile(3)[..., 0]  # one metre a texel
    inverse = np.array([[place[0, 1], place[0, 2]], [-place[0, 2], place[0, 1]]], dtype=float)
    for column, row in ((3, 5), (TILE - 1, 7), (100, TILE - 1)):
        for dx, dy, near in ((0, 0, [(0, 0)]), (0.5, 0, [(0, 0), (0, 1)]), (0, 0.5, [(0, 0), (1, 0)])):
            u, v = inverse @ (np.array([column + dx, row + dy]) - place[0, 3:5])
            expected = np.mean([tile[(row + j) % TILE, (column + i) % TILE] for j, i in near])
            assert octave_value(coded_tile(3, False), place, 0, u, v) == pytest.approx(expected, abs=1e-3)


@given(wavelength=st.floats(0.01, 10), ratio=st.floats(0.001, 5), less=st.floats(0.1, 1))
def test_octaves_fade_out_by_two_pixels(wavelength, ratio, less):
    weight, closer = (octave_weight(wavelength, width * wavelength) for width in (ratio, ratio * less))
    assert 0 <= weight <= closer <= 1
    if ratio >= 0.5:
        assert weight == 0
    if ratio <= 1 / 5.5 - 1e-6:
        assert weight == pytest.approx(1, abs=1e-6)


@pytest.mark.parametrize("seed", [0, 2**31 + 1])
def test_noise_has_unit_variance(seed):
    tile = noise_tile(seed)[:-1, :-1]
    assert np.allclose(tile.std(axis=(0, 1)), 1, atol=1e-3) and np.allclose(tile.mean(axis=(0, 1)), 0, atol=1e-3)
    sampled = noise(places(20_000), WAVELENGTHS, seed, 1)
    assert np.allclose(sampled.std(axis=0), 0.95, atol=0.07)  # interpolation takes a little, most of the slopes


def test_the_tile_has_no_seam():
    tile = noise_tile(9)
    assert np.array_equal(tile[0], tile[-1]) and np.array_equal(tile[:, 0], tile[:, -1])
    wavelength, step = 0.1, 1 / 16  # of a texel
    period = TILE / TEXELS * wavelength
    along = np.arange(0, 4 * period, step * wavelength / TEXELS)
    uv = np.stack([along, 0.3 * along], axis=1).astype(np.float32)  # crosses borders of the tile both ways
    steps = np.abs(np.diff(values(uv, (wavelength,), 9, 0)))
    steepest = np.abs(np.diff(tile[..., 0], axis=0)).max() + np.abs(np.diff(tile[..., 0], axis=1)).max()
    assert steps.max() < 1.2 * step * steepest


def test_most_of_the_power_lies_about_the_wavelength():
    wavelength, n, pixel = 0.2, 256, 0.025
    axis = np.arange(n) * pixel
    uv = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2).astype(np.float32)
    field = values(uv, (1.0, 1.0, 1.0, wavelength), 5, 3).reshape(n, n) * np.hanning(n)[:, None] * np.hanning(n)
    power = np.abs(np.fft.rfft2(field)) ** 2
    octaves = np.log2(np.maximum(np.hypot(np.fft.fftfreq(n)[:, None], np.fft.rfftfreq(n)) / pixel * wavelength, 1e-3))
    assert power[np.abs(octaves) < 1].sum() > 0.9 * power.sum()
    assert abs((octaves * power).sum() / power.sum()) < 0.3


@pytest.mark.parametrize("octave", range(4))  # each is turned by another angle
def test_slopes_are_those_of_the_value(octave):
    uv, wavelength = places(3000), 0.3
    slopes = noise(uv, (wavelength,) * 4, 8, octave)[:, 1:]
    for axis in (0, 1):
        step = np.zeros(2, np.float32)
        step[axis] = wavelength / 8
        ahead, behind = (values(uv + sign * step, (wavelength,) * 4, 8, octave) for sign in (1, -1))
        assert np.corrcoef(ahead - behind, slopes[:, axis])[0, 1] > 0.97
        assert abs(np.corrcoef(ahead - behind, slopes[:, 1 - axis])[0, 1]) < 0.15


def test_seeds_and_octaves_differ():
    uv = places(4000)
    first = values(uv, (0.1, 0.1), 1, 0)
    for seed, octave in ((2, 0), (1, 1)):
        assert abs(np.corrcoef(first, values(uv, (0.1, 0.1), seed, octave))[0, 1]) < 0.1
