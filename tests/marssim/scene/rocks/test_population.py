import numpy as np
import pytest

from marssim.base.dataset.sample import ROVER_CODE
from marssim.scene.rocks.golombek import number_density
from marssim.scene.rocks.population import MAX_BODIES, MAX_ROCKS, RockConfig, _beside_large, draw_population


def test_more_rocks_than_a_dataset_can_number_are_refused():
    """Body n is n + 2 in the 16 bits of surface.png."""
    greatest = MAX_BODIES + 1  # in surface.png, where 0 is the sky and 1 the ground
    assert greatest < ROVER_CODE == np.iinfo(np.uint16).max
    assert MAX_ROCKS < MAX_BODIES
    for seed in range(3):  # every scene is refused, not only those that happen to draw too many
        with pytest.raises(ValueError, match=rf"can hold {MAX_ROCKS} rocks, but \d+ may .*`rocks\.k` or `size`"):
            draw_population(RockConfig(k=0.2), 48.0, 96.0, np.random.default_rng(seed), ())
        with pytest.raises(ValueError, match="may be drawn"):
            # 3 standard deviations below the limit
            draw_population(RockConfig(k=0.0835), 48.0, 96.0, np.random.default_rng(seed), ())


def test_most_rocks_sit_in_the_ground_and_few_lie_on_it():
    drawn = draw_population(RockConfig(k=0.1, buried=(0.1, 0.7)), 10.0, 20.0, np.random.default_rng(0), ())
    buried = drawn.buried
    assert 0.1 <= buried.min() < 0.15 and 0.65 < buried.max() <= 0.7
    assert np.mean(buried < 0.2) < 0.12 and np.mean(buried > 0.4) > 0.55
    ratio = drawn.height / drawn.diameter
    assert ratio[buried > 0.6].mean() < 0.6 * ratio[buried < 0.3].mean()  # what is buried does not stand out


@pytest.mark.parametrize(
    "bad",
    [
        {"k": 0.9},
        {"min_diameter": 0.0},
        {"cluster": 1.5},
        {"height_ratio": 0.0},
        {"buried": (0.4, 0.9)},
        {"families": (0, 0, 0)},
        {"families": (1, float("nan"), 0)},
    ],
)
def test_impossible_rocks_are_refused(bad):
    with pytest.raises(ValueError, match=next(iter(bad))):
        RockConfig(**bad)


def test_rocks_lie_beside_a_large_one_within_its_radius():
    at = np.array([[0.45, 0.0], [0.55, 0.0], [0.0, -0.45]])
    assert _beside_large(at, np.array([1.0]), np.zeros((1, 2))).tolist() == [False, True, False]


@pytest.mark.parametrize(("k", "share"), [(0.15, 0.92), (0.2, 0.9), (0.4, 0.78)])
def test_far_cobbles_are_fewer_than_by_the_law_by_those_that_would_lie_on_a_rock(k, share):
    shares = []
    for seed in range(3):
        drawn = draw_population(RockConfig(k=k), 16.0, 44.0, np.random.default_rng(seed), ())
        away = np.abs(drawn.xy).max(axis=1)
        cobbles = (away >= 20) & (away < 32) & (drawn.diameter >= 0.12) & (drawn.diameter < 0.25)
        by_law = number_density(np.array(0.12), k) - number_density(np.array(0.25), k)
        shares.append(cobbles.sum() / (by_law * 4 * (32**2 - 20**2)))
    assert np.mean(shares) == pytest.approx(share, abs=0.025)
