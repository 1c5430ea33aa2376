import numpy as np
import pytest

from marssim.scene.outcrop.config import OutcropConfig, Traits
from marssim.scene.outcrop.ledges import draw_ledges

HALF, HORIZON = 16.0, 48.0
CONFIG = OutcropConfig(ledge_height=(0.3, 0.3), ledge_length=(5.0, 5.0))


def hillside(x, y):
    return 0.12 * y


def drawn(seed=0, density=10.0, ground=hillside, config=CONFIG):
    parts = draw_ledges(config, Traits(ledges=density), HALF, HORIZON, ground, np.random.default_rng(seed))
    return parts[::2], parts[1::2]  # ledges, and the blocks in front of each


def test_ledges_are_as_many_as_asked_for():
    numbers = [len(drawn(seed, 5.0)[0]) for seed in range(20)]
    assert np.mean(numbers) == pytest.approx(5.0 * (2 * 1.4 * HALF) ** 2 / 1000, rel=0.25)
    assert drawn(density=0.0) == ([], [])


def test_ledges_run_along_the_contours_and_face_downhill():
    for ledge in drawn(1)[0]:
        along = np.ptp(ledge.middle[:, 0])
        assert 3.0 < along < 7.5  # 5 m, and it wanders
        tall = ledge.exposed > 0.2
        top = ledge.top_at(ledge.outline[..., 0], ledge.outline[..., 1])
        above = top - hillside(ledge.outline[..., 0], ledge.outline[..., 1])
        south = np.take_along_axis(ledge.outline[..., 1], above.argmax(axis=1)[:, None], axis=1)[:, 0]
        assert (south[tall] < ledge.middle[tall, 1]).mean() > 0.7  # the front lies south


def test_ledges_are_as_high_as_asked_for_and_end_in_the_hill():
    for ledge in drawn(2)[0]:
        assert 0.22 < ledge.exposed.max() < 0.4
        top = ledge.top_at(ledge.outline[..., 0], ledge.outline[..., 1])
        above = top - hillside(ledge.outline[..., 0], ledge.outline[..., 1])
        assert above.min() < 0.02


def test_fallen_blocks_lie_in_front():
    ledges, blocks = drawn(3)
    assert len(ledges) > 5 and min(map(len, blocks)) >= 3
    for ledge, fallen in zip(ledges, blocks, strict=True):
        assert np.median(fallen.middle[:, 1]) < np.median(ledge.middle[:, 1])


def test_ledges_also_stand_on_level_ground():
    ledges = drawn(4, ground=lambda x, y: np.zeros_like(x))[0]
    assert ledges and max(ledge.exposed.max() for ledge in ledges) > 0.25
