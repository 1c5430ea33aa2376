from dataclasses import replace

import numpy as np
import pytest

from marssim.base.compute.compiled import compiled
from marssim.render.relief.surroundings import CELL, CODE, hidden_sky_at, surroundings
from marssim.scene.rocks.mesh import build_rocks
from marssim.scene.rocks.population import RockConfig

HALF = 4.0


def one_rock(diameter: float, height: float, x: float = 0.0, y: float = 0.0):
    none = build_rocks(RockConfig(k=0.0), HALF, 2 * HALF, lambda x, y: 0 * x, np.random.default_rng(0))
    return replace(
        none, centre=np.array([[x, y, 0.1]]), diameter=np.array([diameter]), height=np.array([height]),
        albedo=np.ones(1),
    )  # fmt: skip


@compiled
def look_up(near, half, x, y):
    return hidden_sky_at(near, np.float32(half), np.float32(x), np.float32(y))


def test_half_of_the_sky_is_hidden_at_the_foot_of_a_high_wall_and_none_far_away():
    near = surroundings(one_rock(3.0, 2.0), HALF)
    foot = look_up(near, HALF, -1.5, 0.0)
    away = [look_up(near, HALF, -1.5 - d, 0.0) for d in (0.1, 0.3, 0.6, 1.2)]
    assert foot == pytest.approx(0.5, abs=0.12)  # a cell is most of the smaller reach
    assert (np.diff([foot, *away]) <= 0).all() and away[-1] == 0
    low = surroundings(one_rock(3.0, 0.06), HALF)
    assert look_up(low, HALF, -1.5, 0.0) < 0.6 * foot


def test_fragments_lie_about_a_rock_and_not_far_from_it():
    near = surroundings(one_rock(1.0, 0.5), HALF)
    rubble = near[..., 1] / CODE
    beside, farther, away = (rubble[round((y + HALF) / CELL), round(HALF / CELL)] for y in (0.6, 0.9, 1.4))
    assert beside > 0.4 > 0.3 > farther > 0 and away == 0


def test_the_map_lies_where_the_rock_does():
    near = surroundings(one_rock(0.6, 0.5, 1.03, -2.01), HALF)
    share = near[..., 0].astype(float)
    row, column = (np.indices(share.shape) * share).sum(axis=(1, 2)) / share.sum()
    assert column * CELL - HALF == pytest.approx(1.03, abs=0.02)
    assert row * CELL - HALF == pytest.approx(-2.01, abs=0.02)


def test_slabs_and_ledges_hide_sky_where_they_lie_and_shed_nothing():
    none, slab = one_rock(0.05, 0.05), one_rock(0.6, 0.5, 1.03, -2.01)
    near = surroundings(none, HALF, slab)
    np.testing.assert_array_equal(near[..., 0], surroundings(slab, HALF)[..., 0])
    assert near[..., 0].any() and not near[..., 1:].any()


def test_between_cells_it_is_linear_and_outside_nothing():
    near = np.random.default_rng(0).integers(0, CODE + 1, (9, 9, 2), dtype=np.uint8)
    half = 4 * CELL
    a, b = near[3, 5, 0], near[3, 6, 0]
    assert np.allclose(look_up(near, half, 1.25 * CELL, -CELL), (0.75 * a + 0.25 * b) / CODE, atol=1e-5)
    for x, y in ((half + 0.01, 0), (0, -half - 0.01), (np.inf, 0), (np.nan, 0)):
        assert look_up(near, half, x, y) == 0
