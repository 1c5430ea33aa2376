from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from marssim.scene.landforms import Craters, crater_profile, draw_craters, draw_fresh_craters, ripples
from marssim.scene.relief import ReliefConfig


def dig(ratio, diameter=3.0, fill=4.0):
    """Return the heights around one crater of a given depth over diameter, on a grid of 2 cm."""
    depth = ratio * min(diameter, fill)
    craters = Craters(np.zeros((1, 2)), np.array([diameter]), np.array([min(ratio / 0.2, 1)]), np.array([depth]))
    x = np.arange(-9, 9.001, 0.02)
    heights = np.zeros((len(x), len(x)))
    craters.add_to(heights, x, x)
    return x, heights


@pytest.mark.parametrize("ratio", [0.2, 0.1, 0.03])
def test_a_crater_has_its_depth_from_rim_to_floor(ratio):
    x, heights = dig(ratio)
    assert np.ptp(heights) == pytest.approx(ratio * 3.0, rel=0.02)
    rim = np.unravel_index(heights.argmax(), heights.shape)
    assert 2 * np.hypot(x[rim[0]], x[rim[1]]) == pytest.approx(3.0, abs=0.06)
    assert heights[:, 0] == pytest.approx(0, abs=1e-9)


def test_wide_craters_are_filled_with_sand():
    assert np.ptp(dig(0.2, diameter=5.0, fill=2.5)[1]) == pytest.approx(0.5, rel=0.02)


@given(st.floats(0, 1))
def test_a_profile_has_no_steps(freshness):
    r = np.linspace(0, 4, 4001)
    profile = crater_profile(r, freshness)
    assert np.abs(np.diff(profile)).max() < 0.005
    assert profile[-1] == 0 and profile.argmin() == 0
    assert np.ptp(profile) == pytest.approx(1, abs=1e-6)


def test_the_number_of_craters_falls_with_the_square_of_their_size():
    config = ReliefConfig(crater_density=0.05, crater_max_diameter=20.0)
    many = [draw_craters(config, 50.0, 20.0, np.random.default_rng(seed)).diameter for seed in range(20)]
    count = np.array([sum((d > size).sum() for d in many) for size in (1.0, 2.0, 4.0)]) / 20
    assert count[0] == pytest.approx(500, rel=0.05)
    assert count[1:] / count[0] == pytest.approx([0.25, 0.0625], rel=0.15)
    assert max(d.max() for d in many) <= 20
    assert len(draw_craters(config, 50.0, 0.8, np.random.default_rng(0)).diameter) == 0


def test_fresh_craters_have_steep_walls_and_keep_away_from_clear_discs():
    config = ReliefConfig(fresh_crater_density=0.01, fresh_crater_diameter=(2.0, 5.0))
    clear = ((0.0, 0.0, 3.0), (6.0, 6.0, 2.0))
    craters = draw_fresh_craters(config, 30.0, clear, np.random.default_rng(3))
    assert len(craters.diameter) == pytest.approx(36, abs=15)
    assert craters.diameter.min() >= 2 and craters.diameter.max() <= 5
    for x, y, radius in clear:
        assert (np.hypot(*(craters.centre - (x, y)).T) > radius + craters.diameter / 2).all()
    x, heights = dig(0.2, fill=10.0)
    wall = np.abs(np.diff(heights[len(x) // 2])).max() / 0.02
    assert 35 < np.rad2deg(np.arctan(wall)) < 40


@pytest.mark.parametrize("largest", [1.5, 3.0])
def test_a_heightmap_that_shows_the_large_ones_leaves_the_number_of_small_ones(largest):
    """There are as many craters of a size as without a heightmap: 5/9 and 8/9 of all above 1 m."""
    config = ReliefConfig(crater_density=0.05, crater_max_diameter=25.0)
    many = [draw_craters(config, 50.0, largest, np.random.default_rng(seed)).diameter for seed in range(20)]
    assert sum(map(len, many)) / 20 == pytest.approx(500 * (1 - largest**-2) / (1 - 25**-2), rel=0.05)
    assert max(d.max() for d in many) <= largest


@settings(max_examples=8)
@given(st.floats(0.4, 1.2), st.integers(0, 100))
def test_ripples_have_their_wavelength_and_height(wavelength, seed):
    config = ReliefConfig(ripple_wavelength=wavelength, ripple_amplitude=0.02, ripple_cover=1.0)
    h = ripples(config, 384, 0.06, np.random.default_rng(seed))
    power = np.abs(np.fft.fft2(h - h.mean())) ** 2
    k = np.hypot(np.fft.fftfreq(384, 0.06)[:, None], np.fft.fftfreq(384, 0.06)[None, :])
    edges = np.geomspace(0.3, 8, 40)
    ring = [power[(k >= a) & (k < b)].sum() for a, b in pairwise(edges)]
    peak = np.sqrt(edges[np.argmax(ring)] * edges[np.argmax(ring) + 1])
    assert 1 / peak == pytest.approx(wavelength, rel=0.2)
    assert np.quantile(h, 0.99) - np.quantile(h, 0.01) == pytest.approx(0.04, rel=0.35)


@pytest.mark.parametrize("cover", [0.1, 0.4, 0.8])
def test_ripples_cover_their_share(cover):
    config = ReliefConfig(ripple_cover=cover, ripple_amplitude=0.02)
    h = np.stack([ripples(config, 320, 0.1, np.random.default_rng(seed)) for seed in range(4)])
    assert np.mean(np.abs(h) > 1e-4) == pytest.approx(cover, abs=0.2)


def test_ripples_that_a_grid_cannot_show_are_left_out():
    assert not ripples(ReliefConfig(ripple_wavelength=0.5), 64, 0.2, np.random.default_rng(0)).any()
    assert not ripples(ReliefConfig(ripple_cover=0.0), 64, 0.1, np.random.default_rng(0)).any()


@pytest.mark.parametrize(("size", "wavelength"), [(8.0, 12.0), (8.0, 50.0), (16.0, 28.0)])
def test_ripples_that_are_long_for_the_square_are_still_ripples(size, wavelength):
    config = ReliefConfig(ripple_wavelength=wavelength, ripple_amplitude=0.02, ripple_cover=1.0)
    for seed in range(10):
        h = ripples(config, round(size / 0.08) + 1, 0.08, np.random.default_rng(seed))
        assert np.isfinite(h).all() and 0.004 < np.ptp(h) < 0.08
