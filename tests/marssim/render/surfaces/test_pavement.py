import numpy as np
import pytest

from marssim.base.compute.compiled import compiled
from marssim.render.surfaces.pavement import DEEPEST, SIDE, STEEPEST, TEXEL, TONES, VARIANTS, pavement_at, plates
from marssim.render.surfaces.pyramid import CODES, PlacedTile


@compiled
def look_up(tile, uv, footprint):
    out = np.empty((len(uv), 5))
    placed = PlacedTile(tile, np.float32(1), np.float32(0), np.float32(0))
    for k in range(len(uv)):
        out[k] = pavement_at(placed, np.float32(uv[k, 0]), np.float32(uv[k, 1]), np.float32(footprint))
    return out


def finest(seed: int) -> np.ndarray:
    scale = np.array([STEEPEST, STEEPEST, TONES, 1, DEEPEST]) / CODES
    return plates(seed)[: SIDE * SIDE].reshape(SIDE, SIDE, 5) * scale


@pytest.mark.parametrize("seed", range(VARIANTS))
def test_the_more_is_swept_the_more_plates_show_and_joints_never(seed):
    cover = finest(seed)[..., 4]
    shares = [(cover < swept).mean() for swept in (0.05, 0.3, 0.6, 0.9)]
    assert shares[0] > 0.01 and (np.diff(shares) > 0.05).all() and shares[-1] < 0.97
    assert (cover > 1.2).mean() > 0.03


def test_a_pavement_has_no_seam():
    tile = finest(0)
    for axis in (0, 1):
        step = np.abs(np.diff(tile, axis=axis)).mean(axis=(0, 1))
        seam = np.abs(np.take(tile, 0, axis) - np.take(tile, -1, axis)).mean(axis=0)
        assert (seam < 2 * step).all()


def test_slopes_belong_to_one_surface():
    """Round a square of texels, as round any way that closes, they sum up to no height."""
    east, north = finest(1)[..., 0], finest(1)[..., 1]
    gentle = np.hypot(east, north) < 0.5
    curl = (np.roll(north, -1, 1) - np.roll(north, 1, 1)) - (np.roll(east, -1, 0) - np.roll(east, 1, 0))
    quiet = gentle & np.roll(gentle, 1, 0) & np.roll(gentle, -1, 0) & np.roll(gentle, 1, 1) & np.roll(gentle, -1, 1)
    assert quiet.mean() > 0.5
    assert np.abs(curl[quiet]).max() <= 4.1 * 0.5 * STEEPEST / CODES + 1e-9  # of rounding to codes alone


def test_cracks_lie_on_the_borders_of_plates():
    tile = finest(0)
    tone, crack = tile[..., 2], tile[..., 3]
    jump = np.hypot(np.roll(tone, -2, 0) - np.roll(tone, 2, 0), np.roll(tone, -2, 1) - np.roll(tone, 2, 1))
    assert jump[crack > 0.5].mean() > 1.3 * jump[crack < 0.05].mean()


def test_a_look_up_shows_the_texel_and_the_mean_of_a_wide_pixel():
    tile, whole = plates(0), finest(0)
    index = np.random.default_rng(0).integers(0, SIDE, (200, 2))
    assert np.allclose(look_up(tile, index * TEXEL, TEXEL), whole[index[:, 1], index[:, 0]], atol=0.05)
    wide = look_up(tile, np.random.default_rng(1).uniform(-9, 9, (20, 2)), 2 * SIDE * TEXEL)
    assert np.allclose(wide, whole.mean((0, 1)), atol=0.02)
