import numpy as np
import pytest

from marssim.base.compute.compiled import compiled
from marssim.render.surfaces.pyramid import CHANNELS, CODES, PlacedTile, pyramid, pyramid_at


@compiled
def look_up(tile, side, uv, footprint, cosine, sine, offset):
    out = np.empty((len(uv), CHANNELS))
    placed = PlacedTile(tile, np.float32(cosine), np.float32(sine), np.float32(offset))
    for k in range(len(uv)):
        out[k] = pyramid_at(placed, side, 0.5, np.float32(uv[k, 0]), np.float32(uv[k, 1]), np.float32(footprint))
    return out


@pytest.mark.parametrize("side", [8, 32])
def test_a_pyramid_keeps_codes_at_every_level_and_the_mean_at_the_last(side):
    finest = np.random.default_rng(0).uniform(-CODES, CODES, (side, side, CHANNELS)).astype(np.float32)
    tile = pyramid(finest)
    assert len(tile) == (4 * side * side - 1) // 3 and tile.dtype == np.int8
    assert np.array_equal(tile[: side * side].reshape(finest.shape), np.rint(finest))
    assert np.allclose(tile[-1], finest.mean((0, 1)), atol=0.51)


def test_a_look_up_is_periodic_shifted_and_turned():
    side = 16
    finest = np.random.default_rng(1).uniform(-CODES, CODES, (side, side, CHANNELS)).astype(np.float32)
    tile = pyramid(finest)
    rows, columns = np.indices((side, side)).reshape(2, -1)
    texels = np.rint(finest).reshape(-1, CHANNELS)
    at = 0.5 * np.stack([columns, rows], axis=1)
    assert np.allclose(look_up(tile, side, at, 0.5, 1, 0, 0), texels)
    assert np.allclose(look_up(tile, side, at + 0.5 * side, 0.5, 1, 0, 0), texels)
    assert np.allclose(look_up(tile, side, at - 1.0, 0.5, 1, 0, 2), texels)
    # a quarter turn: u of the surface is y of the tile
    turned = look_up(tile, side, np.stack([at[:, 1], -at[:, 0]], axis=1), 0.5, 0, 1, 0)
    assert np.allclose(turned[:, 2:], texels[:, 2:])
    assert np.allclose(turned[:, :2], np.stack([texels[:, 1], -texels[:, 0]], axis=1))
