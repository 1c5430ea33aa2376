import numpy as np
import pytest

from marssim.scene.outcrop.shedding import FOOT, PARENT_SIZE, Shedding, shed

LAW = Shedding(sizes=(0.02, 0.2), steepness=1.5, largest_share=0.5, most=30, reach=0.4)
SIZE = np.repeat([0.3, 1.0], 3000)
MIDDLE = np.random.default_rng(0).uniform(-20, 20, (len(SIZE), 2))


def drawn(density=4.0, law=LAW):
    return shed(law, np.full(len(SIZE), density), MIDDLE, SIZE, np.random.default_rng(1))


def test_the_number_is_proportional_to_the_diameter_of_the_body():
    number = np.bincount(drawn().parent, minlength=len(SIZE)).reshape(2, -1).mean(axis=1)
    assert number[1] == pytest.approx(4 / PARENT_SIZE, rel=0.03) and number[0] == pytest.approx(
        0.3 * number[1], rel=0.05
    )
    assert np.bincount(drawn(100.0).parent).max() == LAW.most and len(drawn(0.0)) == 0


def test_diameters_follow_a_power_law():
    pieces = drawn()
    large = pieces.diameter[SIZE[pieces.parent] == 1]
    assert LAW.sizes[0] <= large.min() and large.max() <= LAW.sizes[1]
    assert (large > 0.08).sum() / (large > 0.04).sum() == pytest.approx(2**-1.5, rel=0.2)
    assert (pieces.diameter < LAW.largest_share * SIZE[pieces.parent]).all()


def test_pieces_lie_outside_their_bodies():
    pieces = drawn()
    size = SIZE[pieces.parent]
    foot = np.hypot(*(pieces.xy - MIDDLE[pieces.parent]).T) / size - 0.5
    assert foot.min() >= 0.5 * FOOT[0] - 0.5 - 1e-9 and foot.mean() == pytest.approx(LAW.reach, rel=0.1)
