"""The places of rocks: random, some beside a larger rock, and none on top of another.

Overlapping rocks would show less than their outlines and cover less ground than asked for. So rocks are placed from the
largest to the smallest, and one that would lie on an earlier rock moves elsewhere.
"""

from __future__ import annotations

import numpy as np
import scipy

GAP = 1.08  # least distance of two centres, in mean diameters; above 1 because outlines are no discs
LARGER_SHARE = 0.3  # share of the larger rocks, from the largest down, that others cluster around
ROUNDS = 30  # moves after which a rock stays, even if it overlaps another
CLUSTERED_ROUNDS = 6  # of these, the moves that keep a clustered rock beside its larger neighbour


def place(
    diameter: np.ndarray, inner: np.ndarray, outer: np.ndarray, cluster: float, rng: np.random.Generator
) -> np.ndarray:
    """Draw the positions of rocks, each in a square ring inner <= max(|x|, |y|) <= outer.

    Args:
        diameter: (N,) diameters [m], in any order.
        inner: (N,) inner half sides of the rings [m].
        outer: (N,) outer half sides of the rings [m].
        cluster: Share of the rocks that lie within a few diameters of a larger rock of their ring.
        rng: Random generator.

    Returns:
        (N, 2) positions [m].
    """
    n = len(diameter)
    order = np.argsort(-diameter, kind="stable")
    diameter, inner, outer = diameter[order], inner[order], outer[order]
    xy = _in_ring(inner, outer, rng)
    parent, pick = np.arange(n), rng.uniform(0, LARGER_SHARE, n)
    for ring in np.unique(outer):
        members = np.flatnonzero(outer == ring)
        parent[members] = members[(pick[members] * np.arange(len(members))).astype(int)]
    clustered = (rng.uniform(0, 1, n) < cluster) & (parent < np.arange(n))
    placed: list[tuple[scipy.spatial.cKDTree, np.ndarray]] = []
    start = 0
    while start < n:  # classes of similar size, within a factor of two
        end = start + int(np.searchsorted(-diameter[start:], -0.5 * diameter[start], side="right"))
        moving = np.arange(start, end)
        xy[moving] = _beside(xy, diameter, parent, clustered, inner, outer, moving, 0, rng)
        settled = list(placed)
        for attempt in range(1, ROUNDS + 1):
            bad = _clashes(xy[moving], diameter[moving], settled) if attempt < ROUNDS else np.zeros(0, dtype=int)
            good = np.delete(moving, bad)
            if len(good):
                settled.append((scipy.spatial.cKDTree(xy[good]), diameter[good]))
            moving = moving[bad]
            if len(moving) == 0:
                break
            xy[moving] = _in_ring(inner[moving], outer[moving], rng)
            if attempt < CLUSTERED_ROUNDS:
                xy[moving] = _beside(xy, diameter, parent, clustered, inner, outer, moving, attempt, rng)
        placed.append((scipy.spatial.cKDTree(xy[start:end]), diameter[start:end]))
        start = end
    out = np.empty_like(xy)
    out[order] = xy
    return out


def _in_ring(inner: np.ndarray, outer: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Draw (N, 2) points uniformly in square rings: one of the ring's four equal arms, then a point in it."""
    n = len(inner)
    along = rng.uniform(-1, 1, n) * (outer + inner) / 2 + (outer - inner) / 2
    across = inner + rng.uniform(0, 1, n) * (outer - inner)
    quarter = rng.integers(0, 4, n)
    # the arm x in [inner, outer], y in [-inner, outer], and its turns by 90 degrees
    c, s = np.array([1, 0, -1, 0])[quarter], np.array([0, 1, 0, -1])[quarter]
    return np.stack([c * across - s * along, s * across + c * along], axis=1)


def _beside(
    xy: np.ndarray, diameter: np.ndarray, parent: np.ndarray, clustered: np.ndarray, inner: np.ndarray,
    outer: np.ndarray, members: np.ndarray, attempt: int, rng: np.random.Generator,
) -> np.ndarray:  # fmt: skip
    """Return positions of the rocks `members`: near the parent if clustered and still in the ring, else as before."""
    parents = parent[members]
    spread = (0.4 + diameter[parents]) * (1 + 0.4 * attempt)
    reach = 0.5 * GAP * (diameter[parents] + diameter[members]) + np.abs(rng.normal(0, 1, len(members))) * spread
    angle = rng.uniform(0, 2 * np.pi, len(members))
    beside = xy[parents] + reach[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    far = np.abs(beside).max(axis=1)
    near = clustered[members] & (far >= inner[members]) & (far <= outer[members])
    return np.where(near[:, None], beside, xy[members])


def _clashes(
    xy: np.ndarray, diameter: np.ndarray, settled: list[tuple[scipy.spatial.cKDTree, np.ndarray]]
) -> np.ndarray:
    """Return the indices of the candidates that overlap a settled rock or an earlier candidate."""
    tree = scipy.spatial.cKDTree(xy)
    bad = np.zeros(len(xy), dtype=bool)
    for other, size in settled:
        limit = 0.5 * GAP * float(size.max() + diameter.max())
        pairs = tree.sparse_distance_matrix(other, limit, output_type="ndarray")
        bad[pairs["i"][pairs["v"] < 0.5 * GAP * (diameter[pairs["i"]] + size[pairs["j"]])]] = True
    pairs = tree.query_pairs(GAP * float(diameter.max()), output_type="ndarray")
    first, second = pairs.min(axis=1), pairs.max(axis=1)
    gap = np.linalg.norm(xy[first] - xy[second], axis=1)
    close = (gap < 0.5 * GAP * (diameter[first] + diameter[second])) & ~bad[first]
    bad[second[close]] = True
    return np.flatnonzero(bad)
