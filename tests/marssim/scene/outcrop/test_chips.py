import numpy as np

from marssim.scene.outcrop.chips import EDGE_HEIGHTS, HEIGHT_RATIOS, SIZES, draw_chips
from marssim.scene.outcrop.config import Traits
from marssim.scene.outcrop.pavement import draw_slabs
from marssim.scene.outcrop.polygons import area_and_centroid

HALF = 8.0


def level_ground(x, y):
    return np.zeros_like(x)


SLABS = draw_slabs(Traits(slabs=0.4, slab_size=0.6), HALF, 24.0, level_ground, np.random.default_rng(0))


def drawn(density, parents=SLABS, most=10_000):
    return draw_chips(parents, Traits(fragments=density), HALF, level_ground, most, np.random.default_rng(1))


def outlined(part):
    """Return the diameters of the discs with the areas of whole outlines."""
    area = area_and_centroid(part.outline, np.full(len(part), part.outline.shape[1]))[0]
    return np.sqrt(4 / np.pi * area)


def test_chips_are_thinner_than_they_are_wide():
    for part in drawn(1.0):
        whole = outlined(part)
        assert part.diameter.max() < 1.5 * SIZES[1]
        assert EDGE_HEIGHTS[0] <= part.exposed.min() <= part.exposed.max() <= EDGE_HEIGHTS[1]
        assert (part.exposed < 0.5 * whole).all() and np.median(part.exposed / whole) < 1.2 * HEIGHT_RATIOS[1]


def test_diameters_and_middles_are_those_of_what_shows():
    for part in drawn(1.0):
        top = part.top_at(part.outline[..., 0], part.outline[..., 1])
        out, whole = (top > 0).all(axis=1), outlined(part)
        assert 0.2 < out.mean() < 1 and np.allclose(part.diameter[out], whole[out])
        assert (part.diameter[~out] < whole[~out]).all()
        centre = part.top_at(part.middle[:, 0], part.middle[:, 1])
        assert (centre > -1e-9).all()


def test_chips_lie_around_slabs():
    slabs = np.concatenate([part.middle for part in SLABS])
    for part in drawn(1.0):
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


def test_the_largest_in_view_are_kept():
    every, few = (np.concatenate([part.middle for part in drawn(1.0, most=most)]) for most in (10_000, 150))
    assert len(few) == 150 < len(every)
    assert np.abs(few).max(axis=1).mean() < np.abs(every).max(axis=1).mean()
