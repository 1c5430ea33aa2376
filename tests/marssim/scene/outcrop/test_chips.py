import numpy as np

from marssim.scene.outcrop.chips import EDGE, SIZES, draw_chips
from marssim.scene.outcrop.config import Traits
from marssim.scene.outcrop.pavement import draw_slabs

HALF = 8.0


def level_ground(x, y):
    return np.zeros_like(x)


SLABS = draw_slabs(Traits(slabs=0.4, slab_size=0.6), HALF, 24.0, level_ground, np.random.default_rng(0))


def drawn(density, parents=SLABS):
    return draw_chips(parents, Traits(fragments=density), HALF, level_ground, np.random.default_rng(1))


def test_chips_lie_around_slabs_and_are_thinner_than_they_are_wide():
    slabs = np.concatenate([part.middle for part in SLABS])
    for part in drawn(1.0):
        assert part.diameter.max() < 1.5 * SIZES[1] and EDGE[0] <= part.exposed.min() <= part.exposed.max() <= EDGE[1]
        gap = np.hypot(*(part.middle[:, None] - slabs[None]).transpose(2, 0, 1)).min(axis=1)
        assert np.median(gap) < 0.8


def test_the_highest_edge_of_a_chip_stands_out_of_the_ground_and_its_sides_end_below_it():
    for part in drawn(1.0):
        top = part.top_at(part.outline[..., 0], part.outline[..., 1])
        assert np.allclose(top.max(axis=1), part.exposed)
        assert ((top - part.thickness[:, None]).min(axis=1) < 0).all()


def test_their_number_follows_the_density():
    few, many = (sum(map(len, drawn(density))) for density in (0.2, 1.0))
    assert 100 < 2 * few < many
    assert drawn(0.0) == [] and drawn(1.0, []) == []
