import math

import numpy as np
import pytest

from marssim.base.compute.compiled import compiled
from marssim.render.surfaces.grain import STEP, TEXELS, TILE
from marssim.render.surfaces.pyramid import PlacedTile
from marssim.render.surfaces.regolith import (
    CODES,
    COVER,
    GRAIN,
    SIDE,
    SIZES,
    STEEPEST,
    TEXEL,
    TONES,
    VARIANTS,
    gravel,
    grit,
    grit_at,
    ripple_tile,
)

UP = np.array([0.0, 0.0, 1.0])


def sun(elevation_deg: float, azimuth_deg: float = 0.0) -> np.ndarray:
    elevation, azimuth = np.deg2rad([elevation_deg, azimuth_deg])
    return np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])


def level(tile: np.ndarray, n: int) -> np.ndarray:
    """(side, side, 5) in units: level n of the tile."""
    start = sum((SIDE >> m) ** 2 for m in range(n))
    side = SIDE >> n
    scale = np.array([STEEPEST, STEEPEST, TONES, 1, GRAIN]) / CODES
    return tile[start : start + side * side].reshape(side, side, 5) * scale


@compiled
def look_up(tile, uv, footprint, cosine, sine):
    out = np.empty((len(uv), 5))
    placed = PlacedTile(tile, np.float32(cosine), np.float32(sine), np.float32(0))
    for k in range(len(uv)):
        out[k] = grit_at(placed, np.float32(uv[k, 0]), np.float32(uv[k, 1]), np.float32(footprint))
    return out


@pytest.fixture(scope="module")
def tile() -> np.ndarray:
    return grit(1, 0.0, sun(30), -0.2)


def test_pebbles_cover_what_they_shall():
    heights, tones, grain = gravel(1)
    stone = heights > 0
    # those that lie on others add no cover
    assert 0.8 * COVER < -math.log(1 - stone.mean()) < 1.1 * COVER
    assert not tones[~stone].any() and heights.max() * TEXEL < 0.8 * SIZES[1]
    assert grain.std() == pytest.approx(1, abs=1e-3)


def test_grain_has_equal_power_in_each_octave():
    power = np.abs(np.fft.rfft2(gravel(2)[2])) ** 2
    k = np.hypot(np.fft.fftfreq(SIDE, TEXEL)[:, None], np.fft.rfftfreq(SIDE, TEXEL)[None, :])
    octaves = [power[(k >= f) & (k < 2 * f)].sum() for f in (1 / 0.13, 1 / 0.065, 1 / 0.0325, 1 / 0.01625)]
    assert max(octaves) < 1.4 * min(octaves)


def test_shadows_are_those_of_the_height_field():
    """Against rays marched in floating point at a tenth of the kernel's step, at some texels away from borders."""
    azimuth, elevation, turn = 25.0, 22.0, 0.7
    heights = gravel(3)[0]
    shade = level(grit(3, turn, sun(elevation, azimuth), 0.0), 0)[..., 3]
    angle = np.deg2rad(azimuth) + turn
    rise = math.tan(np.deg2rad(elevation))
    rng = np.random.default_rng(0)
    row, column = rng.integers(60, SIDE - 60, (2, 4000))
    hidden = np.zeros(4000, dtype=bool)
    for step in np.arange(1, 40, 0.1):
        i, j = np.rint(column + step * np.cos(angle)).astype(int), np.rint(row + step * np.sin(angle)).astype(int)
        hidden |= heights[j, i] > heights[row, column] + step * rise
    assert 0.02 < hidden.mean() < 0.5
    assert (hidden == (shade[row, column] > 0.5)).mean() > 0.97


def test_no_shadows_under_a_sun_at_zenith_and_longer_ones_under_a_low_sun():
    shares = [level(grit(0, 0.3, sun(e, 80), 0.0), 0)[..., 3].mean() for e in (89.9, 60, 30, 10)]
    assert shares[0] == 0 and (np.diff(shares) > 0).all()


def test_slopes_are_those_of_the_heights(tile):
    heights = gravel(1)[0]
    stone = heights > 2  # above the grain
    east = level(tile, 0)[..., 0]
    expected = np.clip((np.roll(heights, -1, 1) - np.roll(heights, 1, 1)) / 2, -STEEPEST, STEEPEST)
    assert np.corrcoef(east[stone], expected[stone])[0, 1] > 0.95


def test_each_level_is_the_mean_of_the_one_before(tile):
    for n in (1, 4, 10):
        fine, coarse = level(tile, n - 1), level(tile, n)
        mean = (fine[::2, ::2] + fine[1::2, ::2] + fine[::2, 1::2] + fine[1::2, 1::2]) / 4
        assert np.abs(mean - coarse).max() <= 1.1 * max(STEEPEST, TONES, GRAIN) / CODES
    assert len(tile) == (4 * SIDE * SIDE - 1) // 3


def test_a_look_up_shows_the_texel_and_the_mean_of_a_wide_pixel(tile):
    rng = np.random.default_rng(1)
    index = rng.integers(0, SIDE, (200, 2))
    got = look_up(tile, index * TEXEL, TEXEL, 1.0, 0.0)
    assert np.allclose(got, level(tile, 0)[index[:, 1], index[:, 0]], atol=0.02)
    wide = look_up(tile, rng.uniform(-5, 5, (50, 2)), 2 * SIDE * TEXEL, 1.0, 0.0)
    assert np.allclose(wide, level(tile, 10)[0, 0], atol=1e-6)


def test_between_levels_there_is_no_jump(tile):
    uv = np.random.default_rng(2).uniform(-3, 3, (300, 2))
    for width in (TEXEL, 2 * TEXEL, 4 * TEXEL):
        below, above = look_up(tile, uv, 0.999 * width, 1.0, 0.0), look_up(tile, uv, 1.001 * width, 1.0, 0.0)
        assert np.abs(below - above).max() < 0.01


def test_a_level_lies_where_the_finer_one_does(tile):
    """The look-up of a pixel four texels wide is the mean over it, nowhere half a texel off."""
    rng = np.random.default_rng(3)
    uv = rng.uniform(0, 2, (400, 2))
    wide = look_up(tile, uv, 4 * TEXEL, 1.0, 0.0)[:, 4]

    def mean(shift: float) -> np.ndarray:
        steps = (np.arange(16) + 0.5) / 16 * 4 - 2
        at = uv[:, None, None] + TEXEL * (np.stack(np.meshgrid(steps, steps), -1) + np.array([shift, 0]))
        return look_up(tile, at.reshape(-1, 2), TEXEL, 1.0, 0.0)[:, 4].reshape(400, -1).mean(1)

    right, off = (np.corrcoef(wide, mean(shift))[0, 1] for shift in (0.0, 2.0))
    assert right > 0.95 and right > off + 0.01


def test_slopes_turn_with_the_tile():
    flat = grit(1, 0.0, UP, 0.0)
    angle = 0.6
    uv = np.random.default_rng(4).uniform(-2, 2, (100, 2))
    turned = uv @ np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    still, moved = look_up(flat, turned, TEXEL, 1.0, 0.0), look_up(flat, uv, TEXEL, np.cos(angle), np.sin(angle))
    assert np.allclose(still[:, 2:], moved[:, 2:], atol=1e-3)
    back = still[:, :2] @ np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    assert np.allclose(back, moved[:, :2], atol=2e-3)


@pytest.mark.parametrize("seed", range(VARIANTS))
def test_ripples_run_across_the_wind(seed):
    field, along, across = np.moveaxis(ripple_tile(seed)[:-1, :-1] * STEP, -1, 0)
    assert field.std() == pytest.approx(1, abs=0.01)
    assert np.mean(along**2 + across**2) == pytest.approx(1, abs=0.01) and along.std() > 2.5 * across.std()
    power = np.abs(np.fft.rfft2(field)) ** 2
    k = np.fft.rfftfreq(TILE) * TEXELS
    power[0, 0] = 0
    assert 0.8 < (k * power.sum(0))[(k > 0.5) & (k < 1.5)].sum() / power.sum(0)[(k > 0.5) & (k < 1.5)].sum() < 1.2
    assert np.array_equal(ripple_tile(seed)[0], ripple_tile(seed)[-1])
    assert -np.percentile(along, 1) > 1.1 * np.percentile(along, 99)  # the lee is the steeper side
