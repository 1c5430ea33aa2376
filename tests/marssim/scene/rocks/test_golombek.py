import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from marssim.scene.rocks.golombek import MAX_DIAMETER, covered_area, draw_diameters, number_density, sampling_spread


@given(st.floats(0.02, 0.3), st.floats(0.06, 1.0))
def test_number_density_integrates_to_the_covered_area(k, smallest):
    """Golombek's N(>D) and F_k(D) are two views of one population."""
    d = np.geomspace(smallest, 60, 20_000)
    number = number_density(d, k)
    area = np.sum(-np.diff(number) * np.pi / 4 * ((d[1:] + d[:-1]) / 2) ** 2)
    assert area == pytest.approx(float(covered_area(np.array(smallest), k)), rel=0.02)


def test_counts_are_those_of_the_published_table():
    for k, at_tenth, at_third, at_metre in ((0.033, 69.6, 3.7, 0.01), (0.07, 138, 13.3, 0.12), (0.20, 333, 45.9, 1.2)):
        got = 100 * number_density(np.array([0.1, 0.3, 1.0]), k)
        assert got == pytest.approx([at_tenth, at_third, at_metre], rel=0.05, abs=0.005)


def test_drawn_diameters_cover_and_scatter_as_the_law_says():
    drawn = [draw_diameters(0.07, 0.1, 400.0, np.random.default_rng(seed)) for seed in range(300)]
    areas = np.array([np.sum(np.pi / 4 * d**2) / 400 for d in drawn])
    assert all((np.diff(d) <= 0).all() for d in drawn)
    expected = float(covered_area(np.array(0.1), 0.07) - covered_area(np.array(MAX_DIAMETER), 0.07))
    spread = float(sampling_spread(np.array(0.1), 0.07, 400.0))
    assert np.mean(areas) == pytest.approx(expected, abs=4 * spread / np.sqrt(300))
    assert np.std(areas) == pytest.approx(spread, rel=0.2)


def test_rocks_beyond_the_largest_diameter_are_left_out_and_not_made_smaller():
    d = draw_diameters(0.4, 2.0, 1e6, np.random.default_rng(0))
    for diameter in (2.0, 2.499):
        expected = 1e6 * (number_density(np.array(diameter), 0.4) - number_density(np.array(MAX_DIAMETER), 0.4))
        assert np.sum(d >= diameter) == pytest.approx(expected, abs=4 * np.sqrt(expected))


def test_no_rocks_at_k_zero():
    assert len(draw_diameters(0.0, 0.1, 900.0, np.random.default_rng(0))) == 0
    for law in (covered_area(np.array([0.1]), 0.0), number_density(np.array([0.1]), 0.0)):
        assert law == [0.0]
    assert sampling_spread(np.array([0.1]), 0.0, 1.0) == [0.0]
