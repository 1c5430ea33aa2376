import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from marssim.base.compute.compiled import compiled
from marssim.render.relief.layers import FRACTAL, FRACTAL_WAVES, fractal_levels
from marssim.render.relief.tiles import FINEST, NONE, WHOLE, Tile, level_at, nearest_level, shown, tile_at, tile_levels

SIDE, SPACING, LEVELS = 128, 0.01, 4


@compiled
def look_up(coefficients, tile, xy, footprint):
    out = np.empty((len(xy), 3))
    for k in range(len(xy)):
        out[k] = tile_at(coefficients, tile, np.float32(xy[k, 0]), np.float32(xy[k, 1]), np.float32(footprint[k]))
    return out


@compiled
def nearest(coefficients, tile, x, y, dx, dy, footprint):
    level = nearest_level(tile, np.float32(x), np.float32(y), np.float32(footprint))
    return level_at(coefficients, level, tile[4], tile[5], np.float32(dx), np.float32(dy))


def placed(side: int, spacing: float, levels: int, turn: float = 0.0, offset: float = 0.0) -> Tile:
    return Tile(
        np.int32(0), np.int32(side), np.int32(levels), np.float32(spacing), np.float32(np.cos(turn)),
        np.float32(np.sin(turn)), np.float32(offset),
    )  # fmt: skip


def wave(length: float) -> np.ndarray:
    """(SIDE, SIDE) heights of a wave along x of that length [nodes]."""
    return np.cos(2 * np.pi * np.arange(SIDE) / length)[None, :] * np.ones((SIDE, 1))


def at(xy: np.ndarray, tile: Tile, coefficients: np.ndarray, footprint) -> np.ndarray:
    return look_up(coefficients, tile, np.asarray(xy, dtype=float), np.broadcast_to(footprint, len(xy)).astype(float))


def fractal() -> tuple[Tile, np.ndarray]:
    return placed(*FRACTAL, turn=0.4, offset=7.0), fractal_levels(0, *FRACTAL, FRACTAL_WAVES)


def somewhere(count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-5, 5, (count, 2))


@given(st.floats(0.001, 10), st.floats(0.001, 10))
def test_a_wave_shows_fully_if_it_is_resolved_and_not_at_all_below_two_pixels(wavelength, footprint):
    share = float(shown(np.array(wavelength), footprint))
    assert 0 <= share <= 1 and share <= float(shown(np.array(2 * wavelength), footprint))
    if wavelength >= WHOLE * footprint:
        assert share == pytest.approx(1)
    if wavelength <= NONE * footprint:
        assert share == 0


@pytest.mark.parametrize("length", [8, 16, 32])
def test_each_level_shows_only_the_waves_that_it_resolves(length):
    coefficients, tile = tile_levels(wave(length), SPACING, LEVELS), placed(SIDE, SPACING, LEVELS)
    for level in range(1, LEVELS):
        width = SPACING * 2**level
        heights = at(somewhere(2000), tile, coefficients, width)[:, 0]
        expected = float(shown(np.array(length * SPACING), width))
        assert heights.std() * np.sqrt(2) == pytest.approx(expected, abs=0.03)
    assert not at(somewhere(50), tile, coefficients, 2 * length * SPACING * 2**LEVELS).any()


def test_a_tile_is_shifted_turned_and_scaled_with_its_slopes():
    turn, offset, length = 0.7, 5.0, 32
    coefficients, tile = tile_levels(wave(length), SPACING, LEVELS), placed(SIDE, SPACING, LEVELS, turn, offset)
    xy = somewhere(500)
    height, east, north = at(xy, tile, coefficients, SPACING / 2).T
    k = 2 * np.pi / (length * SPACING)
    phase = k * (np.cos(turn) * xy[:, 0] - np.sin(turn) * xy[:, 1] + offset * SPACING)
    assert np.allclose(height, np.cos(phase), atol=2e-3)
    assert np.allclose(east, -k * np.cos(turn) * np.sin(phase), atol=0.02 * k)
    assert np.allclose(north, k * np.sin(turn) * np.sin(phase), atol=0.02 * k)


def test_between_levels_there_is_no_jump():
    tile, coefficients = fractal()
    xy, spacing = somewhere(400), FRACTAL[1]
    for width in spacing * np.array([FINEST, 2, 4, 8, 16, 32]):
        below, above = (at(xy, tile, coefficients, share * width) for share in (0.9995, 1.0005))
        assert np.abs(below - above)[:, 0].max() < 1e-5 and np.abs(below - above)[:, 1:].max() < 1e-3


def test_relief_gets_lower_and_gentler_as_pixels_get_wider_until_nothing_shows():
    tile, coefficients = fractal()
    xy = somewhere(3000)
    widths = FRACTAL[1] * np.array([0.5, 1, 2, 4, 8, 16, 30])
    heights, slopes = np.array([
        (values[:, 0].std(), np.hypot(values[:, 1], values[:, 2]).mean())
        for values in (at(xy, tile, coefficients, width) for width in widths)
    ]).T  # fmt: skip
    assert (np.diff(heights) < 0).all() and (np.diff(slopes) < 0).all()
    assert slopes[-1] < 0.02 * slopes[0]
    assert not at(xy, tile, coefficients, FRACTAL[1] * 2.0 ** (FRACTAL[2] + 1)).any()


@given(st.tuples(*[st.floats(-20, 20)] * 2), st.floats(0.0005, 0.2))
def test_slopes_are_the_derivatives_of_the_height(place, footprint):
    tile, coefficients = fractal()
    step = 0.002
    near = np.array(place) + step * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
    values = at(near, tile, coefficients, footprint)
    assert (values[1, 0] - values[2, 0]) / (2 * step) == pytest.approx(values[0, 1], abs=0.012)
    assert (values[3, 0] - values[4, 0]) / (2 * step) == pytest.approx(values[0, 2], abs=0.012)


@given(st.tuples(*[st.floats(-20, 20)] * 2), st.tuples(*[st.floats(-0.2, 0.2)] * 2), st.floats(0.0005, 0.2))
def test_the_nearest_level_is_close_to_the_blend_of_levels(place, step, footprint):
    tile, coefficients = fractal()
    blend = at(np.array([place]) + step, tile, coefficients, footprint)[0]
    alone = np.array(nearest(coefficients, tile, *place, *step, footprint))
    assert np.abs(alone - blend)[0] < 0.006 and np.abs(alone - blend)[1:].max() < 0.35
