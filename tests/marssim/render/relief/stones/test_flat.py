"""The pattern of small stones, compared with a search through all stones."""

from dataclasses import replace

import numpy as np
import pytest

from marssim.base.compute.compiled import compiled
from marssim.render.relief.ground import Ground, ground_relief
from marssim.render.relief.height import cover_at
from marssim.render.relief.stones.bodies import (
    AX,
    AY,
    BARE,
    BX,
    BY,
    CELLS,
    EAST,
    GRAVEL,
    MIDDLE,
    NORTH,
    RANK,
    RISE,
    SAND_STONES,
    SIDE,
    SIZE,
    X,
    Y,
)
from marssim.render.relief.stones.flat import STONE_SEEN, flat_stone
from marssim.render.relief.stones.hits import STONE_FLAT, STONE_NONE
from marssim.scene.presets import preset
from marssim.scene.rocks.population import RockConfig
from marssim.scene.scene import build_scene


@pytest.fixture(scope="module")
def ground() -> Ground:
    base = preset("gravel", size=8.0, horizon=16.0, rocks=RockConfig(k=0.0))
    look = replace(base.look, gravel=(0.6, 0.6), pebbles=(1.0, 1.0))
    return ground_relief(build_scene(replace(base, look=look), 3))


@compiled
def _patterns(data, cover, stones, footprint, points):
    who, share = np.empty(len(points), np.int32), np.empty(len(points), np.float32)
    for k in range(len(points)):
        who[k], share[k] = flat_stone(data, cover, stones, np.float32(footprint), points[k, 0], points[k, 1])
    return who, share


@compiled
def _covers(data, cover, points):
    out = np.empty((len(points), 2), np.float32)
    for k in range(len(points)):
        out[k, 0], _, _, out[k, 1], _ = cover_at(data, cover, np.float32(points[k, 0]), np.float32(points[k, 1]))
    return out


@pytest.fixture(scope="module")
def laid(ground) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """All stones (N, ...), the octave of each (N, ...), where each lies (2, N), and its pattern's period (N,) [m]."""
    stone, octave = ground.stones.stone.astype(float), ground.stones.octave.astype(float)
    own = octave[np.searchsorted(octave[:, SIDE], stone[:, SIZE])]
    return stone, own, (stone[:, [X, Y]] + own[:, [EAST, NORTH]]).T.copy(), CELLS * own[:, SIDE]


def searched(ground: Ground, laid: tuple[np.ndarray, ...], footprint: float, point: np.ndarray) -> np.ndarray:
    """Return the shares (N,) of a pixel at a point (2,) that each of all stones covers."""
    stones, octaves, centre, period = laid
    away = point[:, None] - centre
    away -= period * np.round(away / period)
    near = np.flatnonzero((np.abs(away) < stones[:, SIZE]).all(axis=0))  # none reaches farther
    stone, own, (dx, dy) = stones[near], octaves[near], away[:, near]
    u, v = stone[:, AX] * dx + stone[:, AY] * dy, stone[:, BX] * dx + stone[:, BY] * dy
    rim = np.sqrt(np.maximum(1 - (stone[:, MIDDLE] * stone[:, RISE]) ** 2, 0))
    share = np.clip((rim - np.hypot(u, v)) * stone[:, SIZE] / 2 / footprint, 0, 1)
    seen = np.clip((stone[:, SIZE] / footprint - STONE_NONE) / (STONE_SEEN - STONE_NONE), 0, 1)
    share *= seen**2 * (3 - 2 * seen) * (stone[:, SIZE] <= STONE_FLAT * footprint)
    sand, gravel = _covers(ground.data, ground.relief.cover, point - away[:, near].T).T
    lying = own[:, BARE] * (1 - SAND_STONES * sand) + own[:, GRAVEL] * gravel
    share[stone[:, RANK] > lying] = 0
    shares = np.zeros(len(stones))
    shares[near] = share
    return shares


@pytest.mark.parametrize("footprint", [0.003, 0.008, 0.02])
def test_the_stone_that_covers_most_of_a_pixel_shows(ground, laid, footprint):
    points = np.random.default_rng(0).uniform(-3, 3, (200, 2)).astype(np.float32)
    who, share = _patterns(ground.data, ground.relief.cover, ground.stones, footprint, points)
    assert 0.05 < (who >= 0).mean() < 0.95
    for k in range(len(points)):
        expected = searched(ground, laid, footprint, points[k].astype(float))
        assert share[k] == pytest.approx(expected.max(), abs=2e-3)
        if who[k] >= 0:
            assert expected[who[k]] == pytest.approx(share[k], abs=2e-3)


def test_pixels_wider_than_stones_show_none(ground):
    points = np.random.default_rng(0).uniform(-3, 3, (300, 2)).astype(np.float32)
    who, share = _patterns(ground.data, ground.relief.cover, ground.stones, 0.08 / STONE_NONE, points)
    assert (who == -1).all() and not share.any()
