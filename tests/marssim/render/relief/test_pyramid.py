from itertools import pairwise

import numpy as np
import pytest
from scipy import ndimage

from marssim.base.compute.compiled import compiled
from marssim.render.relief.pyramid import CHANNELS, CODES, pyramid, pyramid_at
from marssim.render.relief.tiles import Tile

SPACING = 0.5  # [m]


@compiled
def look_up(codes, placed, uv, footprint):
    out = np.empty((len(uv), CHANNELS))
    for k in range(len(uv)):
        out[k] = pyramid_at(codes, placed, np.float32(uv[k, 0]), np.float32(uv[k, 1]), np.float32(footprint))
    return out


def placed(side: int, cosine: float = 1, sine: float = 0, offset: float = 0) -> Tile:
    return Tile(
        np.int32(0), np.int32(side), np.int32(1), np.float32(SPACING), np.float32(cosine), np.float32(sine),
        np.float32(offset),
    )  # fmt: skip


def drawn(side: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-CODES, CODES, (side, side, CHANNELS)).astype(np.float32)


@pytest.mark.parametrize("side", [8, 32])
def test_a_pyramid_keeps_codes_at_every_level_and_the_mean_at_the_last(side):
    finest = drawn(side)
    codes = pyramid(finest)
    assert len(codes) == (4 * side * side - 1) // 3 and codes.dtype == np.int8
    assert np.array_equal(codes[: side * side].reshape(finest.shape), np.rint(finest))
    assert np.allclose(codes[-1], finest.mean((0, 1)), atol=0.51)


def test_a_look_up_is_periodic_shifted_and_turned():
    side = 16
    finest = drawn(side, 1)
    codes = pyramid(finest)
    rows, columns = np.indices((side, side)).reshape(2, -1)
    texels = np.rint(finest).reshape(-1, CHANNELS)
    at = SPACING * np.stack([columns, rows], axis=1)
    assert np.allclose(look_up(codes, placed(side), at, SPACING), texels)
    assert np.allclose(look_up(codes, placed(side), at + SPACING * side, SPACING), texels)
    assert np.allclose(look_up(codes, placed(side, offset=2), at - 1.0, SPACING), texels)
    # a quarter turn: u of the surface is y of the tile
    turned = look_up(codes, placed(side, 0, 1), np.stack([at[:, 1], -at[:, 0]], axis=1), SPACING)
    assert np.allclose(turned, texels)


def test_each_level_is_the_mean_of_the_one_before():
    side = 32
    codes = pyramid(drawn(side)).astype(float)
    levels, start = [], 0
    while side:
        levels.append(codes[start : start + side * side].reshape(side, side, CHANNELS))
        start, side = start + side * side, side // 2
    for fine, coarse in pairwise(levels):
        mean = (fine[::2, ::2] + fine[1::2, ::2] + fine[::2, 1::2] + fine[1::2, 1::2]) / 4
        assert np.abs(mean - coarse).max() <= 1.01  # each is rounded to codes


def test_between_levels_there_is_no_jump():
    codes = pyramid(drawn(32, 2))
    uv = np.random.default_rng(2).uniform(-30, 30, (300, 2))
    for width in (SPACING, 2 * SPACING, 4 * SPACING):
        below, above = (look_up(codes, placed(32), uv, share * width) for share in (0.999, 1.001))
        assert np.abs(below - above).max() < 0.01 * CODES


def test_a_level_lies_where_the_finer_one_does():
    """The look-up of a pixel four texels wide is the mean over it, nowhere half a texel off."""
    smooth = ndimage.gaussian_filter(drawn(64, 3), (3, 3, 0), mode="wrap")
    codes = pyramid(smooth * np.float32(CODES / np.abs(smooth).max()))
    uv = np.random.default_rng(3).uniform(0, 32, (400, 2))
    wide = look_up(codes, placed(64), uv, 4 * SPACING)[:, 0]

    def mean(shift: float) -> np.ndarray:
        steps = (np.arange(16) + 0.5) / 16 * 4 - 2
        at = uv[:, None, None] + SPACING * (np.stack(np.meshgrid(steps, steps), -1) + np.array([shift, 0]))
        return look_up(codes, placed(64), at.reshape(-1, 2), SPACING)[:, 0].reshape(400, -1).mean(1)

    right, off = (np.corrcoef(wide, mean(shift))[0, 1] for shift in (0.0, 2.0))
    assert right > 0.98 and right > off + 0.02
