import numpy as np
import pytest

from marssim.base.compute.compiled import compiled
from marssim.render.relief.height import SWEPT_DEPTH
from marssim.render.relief.plates import SIDE, STANDING, TEXEL, TONES, VARIANTS, plate_look_at, plates
from marssim.render.relief.pyramid import CODES
from marssim.render.relief.tiles import Tile

PLACED = Tile(
    np.int32(0), np.int32(SIDE), np.int32(6), np.float32(TEXEL), np.float32(1), np.float32(0), np.float32(0)
)  # fmt: skip


@compiled
def look_up(codes, placed, uv, footprint):
    out = np.empty((len(uv), 2))
    for k in range(len(uv)):
        out[k] = plate_look_at(codes, placed, np.float32(uv[k, 0]), np.float32(uv[k, 1]), np.float32(footprint))
    return out


def look(seed: int) -> np.ndarray:
    """(SIDE, SIDE, 2) tone and crack of each texel."""
    return plates(seed)[1][: SIDE * SIDE].reshape(SIDE, SIDE, 2) * np.array([TONES, 1]) / CODES


@pytest.mark.parametrize("seed", range(VARIANTS))
def test_the_more_is_swept_the_more_plates_show_and_joints_never(seed):
    heights = plates(seed)[0]
    shares = [(heights + SWEPT_DEPTH * swept > 0).mean() for swept in (0.05, 0.3, 0.6, 0.9)]
    assert shares[0] > 0.01 and (np.diff(shares) > 0.05).all() and shares[-1] < 0.97
    assert (heights + SWEPT_DEPTH * 1.2 < -0.3 * STANDING).mean() > 0.015  # sand fills the joints of the barest ground


def test_a_pavement_has_no_seam():
    heights, tile = plates(0)[0], look(0)
    for channel in (heights, tile[..., 0], tile[..., 1]):
        for axis in (0, 1):
            step = np.abs(np.diff(channel, axis=axis)).mean()
            assert np.abs(np.take(channel, 0, axis) - np.take(channel, -1, axis)).mean() < 2 * step


def test_cracks_lie_on_the_borders_of_plates():
    heights, (tone, crack) = plates(0)[0], np.moveaxis(look(0), -1, 0)
    step = round(0.024 / TEXEL)
    jump = np.hypot(*(np.roll(tone, -step, axis) - np.roll(tone, step, axis) for axis in (0, 1)))
    assert jump[crack > 0.5].mean() > 1.3 * jump[crack < 0.05].mean()
    assert heights[crack > 0.5].mean() < heights[crack < 0.05].mean() - 0.2 * STANDING


def test_a_look_up_shows_the_texel_and_the_mean_of_a_wide_pixel():
    codes, whole = plates(0)[1], look(0)
    index = np.random.default_rng(0).integers(0, SIDE, (200, 2))
    assert np.allclose(look_up(codes, PLACED, index * TEXEL, TEXEL), whole[index[:, 1], index[:, 0]], atol=0.05)
    wide = look_up(codes, PLACED, np.random.default_rng(1).uniform(-9, 9, (20, 2)), 2 * SIDE * TEXEL)
    assert np.allclose(wide, whole.mean((0, 1)), atol=0.02)
