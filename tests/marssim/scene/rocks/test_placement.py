import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from marssim.scene.rocks.golombek import draw_diameters
from marssim.scene.rocks.placement import place


def overlaps(xy, diameter):
    """Return the pairs of discs that overlap."""
    pairs = cKDTree(xy).query_pairs(float(diameter.max()), output_type="ndarray")
    gap = np.linalg.norm(xy[pairs[:, 0]] - xy[pairs[:, 1]], axis=1)
    return int(np.sum(gap < 0.5 * (diameter[pairs[:, 0]] + diameter[pairs[:, 1]])))


@settings(max_examples=15)
@given(st.floats(0.01, 0.3), st.floats(0, 1), st.integers(0, 1000))
def test_no_rock_lies_on_another(k, cluster, seed):
    rng = np.random.default_rng(seed)
    d = draw_diameters(k, 0.1, 144.0, rng)
    if len(d) > 1:
        xy = place(d, np.zeros(len(d)), np.full(len(d), 6.0), cluster, rng)
        assert overlaps(xy, d) == 0
        assert np.abs(xy).max() <= 6


@given(st.floats(0, 5), st.floats(0.1, 5), st.integers(0, 1000))
def test_rocks_lie_in_their_ring_evenly(inner, width, seed):
    outer = inner + width
    xy = place(
        np.full(400, 1e-4), np.full(400, inner), np.full(400, outer), cluster=0.0, rng=np.random.default_rng(seed)
    )
    far = np.abs(xy).max(axis=1)
    assert inner - 1e-9 <= far.min() and far.max() <= outer + 1e-9
    middle = np.sqrt((inner**2 + outer**2) / 2)  # the square ring inside it has half the area
    assert np.mean(far < middle) == pytest.approx(0.5, abs=0.13)  # 5 standard deviations
    assert np.abs(np.mean(np.sign(xy), axis=0)).max() < 0.25


def test_the_corners_of_a_ring_are_as_dense_as_its_sides():
    n = 4000
    xy = place(np.full(n, 1e-4), np.full(n, 4.0), np.full(n, 5.0), cluster=0.0, rng=np.random.default_rng(0))
    share = np.mean((np.abs(xy) > 4).all(axis=1))  # four squares of 1 m2, in a ring of 36 m2
    assert share == pytest.approx(1 / 9, abs=0.02)  # 4 standard deviations


def test_clustered_rocks_lie_closer_to_larger_ones():
    d = draw_diameters(0.1, 0.1, 900.0, np.random.default_rng(0))
    large = d > np.quantile(d, 0.7)

    def near(cluster):
        xy = place(d, np.zeros(len(d)), np.full(len(d), 15.0), cluster, np.random.default_rng(1))
        gap, nearest = cKDTree(xy[large]).query(xy[~large])
        return np.median(gap - 0.5 * (d[large][nearest] + d[~large]))

    assert near(0.9) < 0.75 * near(0.0)


def test_rocks_cluster_in_the_middle_too_though_most_large_ones_lie_outside():
    d = np.concatenate([draw_diameters(0.1, 0.1, 400.0, np.random.default_rng(0)), np.full(3000, 0.8)])
    inner = np.where(np.arange(len(d)) < len(d) - 3000, 0.0, 10.0)
    outer = np.where(inner == 0, 10.0, 90.0)

    def near(cluster):
        xy = place(d, inner, outer, cluster, np.random.default_rng(1))[inner == 0]
        members = d[inner == 0]
        large = members > np.quantile(members, 0.7)
        return np.median(cKDTree(xy[large]).query(xy[~large])[0])

    assert near(0.9) < 0.8 * near(0.0)
