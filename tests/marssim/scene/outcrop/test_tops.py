from dataclasses import replace

import numpy as np

from marssim.scene.outcrop.config import Traits
from marssim.scene.outcrop.pavement import draw_slabs
from marssim.scene.outcrop.tops import Tops, beside


def level_ground(x, y):
    return np.zeros_like(x)


TRAITS = Traits(slabs=0.4, slab_size=0.6, slab_tilt_deg=3.0, slab_height=0.06)
SLABS = draw_slabs(TRAITS, 8.0, 24.0, level_ground, np.random.default_rng(0))


def test_the_lift_is_the_height_of_the_slab_and_zero_beside_it():
    tops = Tops.from_plates(SLABS, 8.0)
    part = SLABS[0].chosen(np.flatnonzero(np.abs(SLABS[0].middle).max(axis=1) < 6))
    x, y = part.middle.T
    expected = np.maximum(part.top_at(x, y), 0)
    assert np.isclose(tops.lift(x, y, np.zeros_like(x)), expected, atol=1e-6).mean() > 0.95
    grid = np.linspace(-8, 8, 101)
    lift = tops.lift(*np.meshgrid(grid, grid), np.zeros((101, 101)))
    assert 0.03 < (lift > 0).mean() < 0.5 and lift.max() < 0.16
    assert tops.lift(np.array([50.0]), np.array([0.0]), np.zeros(1)) == 0


def test_slabs_under_a_ledge_are_left_out():
    ledge = SLABS[0].chosen(np.flatnonzero(np.abs(SLABS[0].middle).max(axis=1) < 6)[:5])
    ledge = replace(ledge, plane=ledge.plane + np.array([0.5, 0, 0]))
    kept = beside(SLABS, [ledge], 8.0, level_ground)
    assert len(kept[0]) <= len(SLABS[0]) - 5 and beside(SLABS, [], 8.0, level_ground) == SLABS
    gap = np.hypot(*(kept[0].middle[:, None] - ledge.middle).T)
    assert gap.min() > 0.05
