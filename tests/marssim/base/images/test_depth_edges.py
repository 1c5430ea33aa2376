import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from marssim.base.camera import NATECAM
from marssim.base.images.depth_edges import depth_edges


@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.02, 0.3]))
def test_edges_are_those_of_a_plain_search(seed, share):
    rng = np.random.default_rng(seed)
    disparity = rng.choice([0.0, 5.0, 5.5, 7.0, 60.0, 61.1, 80.0, np.nan, np.inf], (9, 11)).astype(np.float32)
    known = np.where(np.isfinite(disparity), disparity, 0)
    edges = depth_edges(disparity, 1.0, share)
    for row, column in np.ndindex(*disparity.shape):
        near = known[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2]
        assert edges[row, column] == (near.max() - near.min() > max(1.0, share * near.max()))


def test_level_ground_has_no_edges():
    """From 1.2 m above ground NaTeCam sees 0.22 px a row, near and far."""
    disparity = np.repeat(np.arange(0, 300)[:, None] * 0.27 / 1.2, 20, axis=1)
    assert not depth_edges(disparity)[1:-1].any()


def test_a_share_allows_for_steep_surfaces_near_by():
    disparity = np.repeat(100.0 + 0.9 * np.arange(30)[:, None], 20, axis=1)  # 1.8 px within 3 rows
    assert depth_edges(disparity)[1:-1].all() and not depth_edges(disparity, share=0.02).any()


@pytest.mark.parametrize("unknown", [np.inf, np.nan, 0.0])
def test_the_border_of_what_is_known_is_an_edge(unknown):
    depth = np.full((20, 20), 8.0, np.float32)
    depth[:, :10] = unknown
    edges = depth_edges(NATECAM.depth_to_disparity(depth))
    assert edges[:, 9:11].all() and not edges[:, :9].any() and not edges[:, 11:].any()
