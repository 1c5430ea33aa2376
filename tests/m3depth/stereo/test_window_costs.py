"""Window costs and semi-global matching against slow and plain versions of themselves."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from m3depth.stereo.classical import PENALTIES
from m3depth.stereo.window_costs import HIGHEST, SCALE, semi_global, window_costs, winners

PATHS = [(dy, dx) for dy in (-1, 0, 1) for dx in (-1, 0, 1) if (dy, dx) != (0, 0)]


def plain_semi_global(costs: np.ndarray, small: int, large: int) -> np.ndarray:
    """Hirschmueller's recursion (Eq. 13), a pixel at a time."""
    reach, height, width = costs.shape
    total = np.zeros(costs.shape, np.int64)
    for dy, dx in PATHS:
        path = np.zeros(costs.shape, np.int64)
        rows = range(height) if dy <= 0 else range(height - 1, -1, -1)
        columns = range(width) if dx <= 0 else range(width - 1, -1, -1)
        for y in rows:
            for x in columns:
                path[:, y, x] = costs[:, y, x]
                py, px = y + dy, x + dx
                if not (0 <= py < height and 0 <= px < width):
                    continue
                before = path[:, py, px]
                for d in range(reach):
                    ways = [before[d], before.min() + large]
                    ways += [before[e] + small for e in (d - 1, d + 1) if 0 <= e < reach]
                    path[d, y, x] += min(ways) - before.min()
        total += path
    return total


@given(st.integers(0, 10_000), st.integers(0, 300), st.integers(0, 1000))
@settings(max_examples=6)
def test_eight_paths_against_the_plain_recursion(seed, small, more):
    rng = np.random.default_rng(seed)
    costs = rng.integers(0, HIGHEST + 1, (rng.integers(2, 7), rng.integers(1, 6), rng.integers(1, 8))).astype(np.uint16)
    assert np.array_equal(semi_global(costs, small, small + more), plain_semi_global(costs, small, small + more))


def test_sums_never_leave_16_bit():
    costs = np.full((4, 6, 7), HIGHEST, np.uint16)
    costs[0, ::2, ::2] = 0
    assert semi_global(costs, 0, HIGHEST).max() <= 65535
    assert np.array_equal(semi_global(costs, 0, HIGHEST), plain_semi_global(costs, 0, HIGHEST))


def test_penalties_that_cannot_be_are_refused():
    costs = np.zeros((2, 2, 2), np.uint16)
    for small, large in ((5, 4), (-1, 3), (0, HIGHEST + 1)):
        with pytest.raises(ValueError, match="penalties must be"):
            semi_global(costs, small, large)


@pytest.mark.parametrize("cost", ["sad", "ssd", "ncc"])
def test_costs_against_windows_cut_out_by_hand(cost):
    rng = np.random.default_rng(2)
    left, right = (rng.integers(90, 110, (15, 24), dtype=np.uint8) for _ in range(2))
    volume = window_costs(left, right, 6, cost, 5)
    assert (volume[4, :, :4] == HIGHEST).all()
    for y, x, d in ((7, 14, 0), (5, 15, 5), (9, 12, 3)):
        a = left[y - 2 : y + 3, x - 2 : x + 3].astype(float)
        b = right[y - 2 : y + 3, x - d - 2 : x - d + 3].astype(float)
        if cost == "ncc":
            expected = 1 - np.corrcoef(a.ravel(), b.ravel())[0, 1]
        else:
            expected = np.abs(a - b).mean() if cost == "sad" else ((a - b) ** 2).mean()
        assert volume[d, y, x] == pytest.approx(min(expected * SCALE[cost], HIGHEST), abs=0.6)
    same = window_costs(left, left, 3, cost, 5)
    assert same[0].max() <= 1
    assert (same[0, 4:-4, 4:-4] < same[1:, 4:-4, 4:-4]).mean() > 0.99


@pytest.mark.parametrize("cost", ["sad", "ssd", "ncc"])
def test_the_true_disparity_costs_nothing_up_to_the_borders(cost):
    """What both images share ends at a column that differs from disparity to disparity: windows end there alike."""
    wall = np.random.default_rng(4).integers(0, 255, (20, 80), dtype=np.uint8)
    volume = window_costs(wall[:, :60], wall[:, 12:72], 16, cost, 9)
    assert volume[12, :, 12:].max() <= 1
    assert (volume[:, :, 16:].argmin(0) == 12).all()


@given(st.integers(0, 10_000))
@settings(max_examples=15)
def test_winners_against_argmin(seed):
    rng = np.random.default_rng(seed)
    reach, height, width = 6, 4, 14
    costs = rng.integers(0, 1000, (reach, height, width)).astype(np.uint16)
    out = winners(costs)
    inside = np.arange(width)[None, :] >= np.arange(reach)[:, None]  # x - d lies in the right image
    masked = np.where(inside[:, None, :], costs.astype(int), 1 << 20)
    best = masked.argmin(axis=0)
    right = np.full((reach, height, width), 1 << 20)
    for d in range(reach):
        right[d, :, : width - d] = masked[d, :, d:]
    right_best = right.argmin(axis=0)
    for y in range(height):
        for x in range(width):
            d = best[y, x]
            if abs(right_best[y, x - d] - d) > 1:
                assert np.isnan(out[y, x])
                continue
            assert abs(out[y, x] - d) <= 0.5
            if 0 < d < min(reach - 1, x):
                a, b, c = masked[d - 1 : d + 2, y, x]
                vertex = (a - c) / (2 * (a - 2 * b + c)) if a - 2 * b + c > 0 else 0
                assert out[y, x] == pytest.approx(d + np.clip(vertex, -0.5, 0.5), abs=1e-5)
            else:
                assert out[y, x] == d


def test_semi_global_matching_bridges_what_has_no_texture():
    """A wall at 6 px with a bare stripe: the cheapest costs alone guess there, the paths do not."""
    rng = np.random.default_rng(5)
    wall = rng.integers(0, 255, (40, 100), dtype=np.uint8)
    left, right = wall[:, :80].copy(), wall[:, 6:86].copy()
    left[:, 36:50] = 128
    right[:, 30:44] = 128
    noise = [rng.normal(0, 1.0, image.shape) for image in (left, right)]
    left, right = (np.clip(i + n, 0, 255).astype(np.uint8) for i, n in zip((left, right), noise))
    costs = window_costs(left, right, 16, "sad", 3)
    alone, together = winners(costs), winners(semi_global(costs, *PENALTIES["sad"]))
    stripe = np.s_[4:-4, 40:46]
    assert np.nanmean(np.abs(together[stripe] - 6) < 1) > 0.95
    assert np.nanmean(np.abs(alone[stripe] - 6) < 1) < 0.6
