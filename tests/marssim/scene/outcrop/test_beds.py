import numpy as np

from marssim.scene.outcrop.beds import THICKNESS, upper_beds
from marssim.scene.outcrop.config import Traits
from marssim.scene.outcrop.pavement import draw_slabs


def level_ground(x, y):
    return np.zeros_like(x)


TRAITS = Traits(slabs=0.4, slab_size=0.6, slab_tilt_deg=3.0, slab_height=0.05)
SLABS = draw_slabs(TRAITS, 8.0, 24.0, level_ground, np.random.default_rng(0))
BEDS = upper_beds(SLABS, np.random.default_rng(1))


def test_some_slabs_carry_beds_and_some_beds_carry_another():
    slabs, beds = sum(map(len, SLABS)), sum(map(len, BEDS))
    assert 0.2 * slabs < beds < 2 * slabs
    height = max(part.exposed.max() for part in BEDS) - max(part.exposed.max() for part in SLABS)
    assert height < 3 * THICKNESS[1] and {part.level for part in BEDS} <= {part.level for part in SLABS}


def test_a_bed_lies_within_the_slab_below_it_and_over_its_top():
    bottom = SLABS[0]
    for bed, middle in zip(BEDS[0].plane, BEDS[0].middle):
        below = np.argmin(np.hypot(*(bottom.middle - middle).T))
        rise = bed @ (1, *middle) - bottom.plane[below] @ (1, *middle)
        assert 0 < rise < 2 * THICKNESS[1]
    assert max(part.diameter.max() for part in BEDS) < max(part.diameter.max() for part in SLABS)


def test_no_slabs_have_no_beds():
    assert upper_beds([], np.random.default_rng(0)) == []
