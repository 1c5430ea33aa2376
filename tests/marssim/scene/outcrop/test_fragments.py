import numpy as np

from marssim.scene.outcrop.config import Traits
from marssim.scene.outcrop.fragments import LEAST_PARENT, SIZES, draw_fragments
from marssim.scene.rocks.mesh import build_rocks
from marssim.scene.rocks.population import RockConfig

HALF = 8.0


def level_ground(x, y):
    return np.zeros_like(x)


ROCKS = build_rocks(RockConfig(k=0.15), HALF, 24.0, level_ground, np.random.default_rng(0))


def drawn(density, seed=0, most=10_000):
    traits = Traits(fragments=density)
    return draw_fragments(ROCKS, [], traits, HALF, level_ground, None, most, np.random.default_rng(seed))


def test_fragments_of_2_to_12_cm_lie_around_large_rocks():
    pieces = drawn(1.0)
    assert len(pieces) > 100
    assert SIZES[0] <= pieces.diameter.min() and pieces.diameter.max() <= SIZES[1] and pieces.height.max() < 0.1
    large = ROCKS.diameter > LEAST_PARENT
    gap = np.hypot(*(pieces.centre[:, None, :2] - ROCKS.centre[None, large, :2]).transpose(2, 0, 1))
    assert np.median((gap - ROCKS.diameter[large] / 2).min(axis=1)) < 0.15


def test_their_number_follows_the_density():
    numbers = [len(drawn(density)) for density in (0.0, 0.3, 1.0)]
    assert numbers[0] == 0 and 2 * numbers[1] < numbers[2]
    assert len(drawn(1.0, most=40)) == 40


def test_they_are_partly_buried():
    pieces = drawn(1.0)
    start = np.searchsorted(pieces.face_rock, np.arange(len(pieces)))
    low = np.minimum.reduceat(pieces.vertices[pieces.faces][..., 2].min(axis=1), start)
    assert (low < 0).all() and (low > -0.12).all()
