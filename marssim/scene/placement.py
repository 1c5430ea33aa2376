"""Where rocks lie: at random, some of them beside a larger one, and none on top of another.

Rocks that overlapped would show less than their outline, and the ground would be less covered than was asked for. So
they are put down from the largest to the smallest, and what would lie on a rock that is there already moves elsewhere.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

GAP = 1.08  # centres are at least the mean diameter times this apart: outlines are no discs
UPPER = 0.3  # of the rocks that are larger: the share, from the largest down, that others cluster around
ROUNDS = 30  # moves after which a rock stays where it is, overlap or not
CLUSTERED_ROUNDS = 6  # of these, moves that keep a clustered rock beside its larger neighbour


def place(
    diameter: np.ndarray, inner: np.ndarray, outer: np.ndarray, cluster: float, rng: np.random.Generator
) -> np.ndarray:
    """(N, 2) positions; rock n lies in the square ring inner[n] <= max(|x|, |y|) <= outer[n].

    diameter: (N,) [m], any order. A share `cluster` lies within a few diameters of one of the larger rocks of its ring.
    """
    n = len(diameter)
    order = np.argsort(-diameter, kind="stable")
    diameter, inner, outer = diameter[order], inner[order], outer[order]
    xy = _in_ring(inner, outer, rng)
    parent, pick = np.arange(n), rng.uniform(0, UPPER, n)
    for ring in np.unique(outer):
        members = np.flatnonzero(outer == ring)
        parent[members] = members[(pick[members] * np.arange(len(members))).astype(int)]
    clustered = (rng.uniform(0, 1, n) < cluster) & (parent < np.arange(n))
    placed: list[tuple[cKDTree, np.ndarray]] = []
    start = 0
    while start < n:  # classes of like size, within a factor of two
        end = start + int(np.searchsorted(-diameter[start:], -0.5 * diameter[start], side="right"))
        waiting = np.arange(start, end)
        xy[waiting] = _beside(xy, diameter, parent, clustered, inner, outer, waiting, 0, rng)
        settled = list(placed)
        for attempt in range(1, ROUNDS + 1):
            bad = _clashes(xy[waiting], diameter[waiting], settled) if attempt < ROUNDS else np.zeros(0, dtype=int)
            good = np.delete(waiting, bad)
            if len(good):
                settled.append((cKDTree(xy[good]), diameter[good]))
            waiting = waiting[bad]
            if len(waiting) == 0:
                break
            xy[waiting] = _in_ring(inner[waiting], outer[waiting], rng)
            if attempt < CLUSTERED_ROUNDS:
                xy[waiting] = _beside(xy, diameter, parent, clustered, inner, outer, waiting, attempt, rng)
        placed.append((cKDTree(xy[start:end]), diameter[start:end]))
        start = end
    out = np.empty_like(xy)
    out[order] = xy
    return out


def _in_ring(inner: np.ndarray, outer: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(N, 2) uniform in square rings: one of the four equal arms of the ring, and a place in it."""
    n = len(inner)
    along = rng.uniform(-1, 1, n) * (outer + inner) / 2 + (outer - inner) / 2
    across = inner + rng.uniform(0, 1, n) * (outer - inner)
    quarter = rng.integers(0, 4, n)
    # the arm x in [inner, outer], y in [-inner, outer], and its turns by 90 degrees
    c, s = np.array([1, 0, -1, 0])[quarter], np.array([0, 1, 0, -1])[quarter]
    return np.stack([c * across - s * along, s * across + c * along], axis=1)


def _beside(
    xy: np.ndarray, diameter: np.ndarray, parent: np.ndarray, clustered: np.ndarray, inner: np.ndarray,
    outer: np.ndarray, who: np.ndarray, attempt: int, rng: np.random.Generator,
) -> np.ndarray:  # fmt: skip
    """Positions of rocks `who`: near the parent if clustered and if that lies in their ring, else as they were."""
    own = parent[who]
    spread = (0.4 + diameter[own]) * (1 + 0.4 * attempt)
    reach = 0.5 * GAP * (diameter[own] + diameter[who]) + np.abs(rng.normal(0, 1, len(who))) * spread
    angle = rng.uniform(0, 2 * np.pi, len(who))
    beside = xy[own] + reach[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    far = np.abs(beside).max(axis=1)
    near = clustered[who] & (far >= inner[who]) & (far <= outer[who])
    return np.where(near[:, None], beside, xy[who])


def _clashes(xy: np.ndarray, diameter: np.ndarray, settled: list[tuple[cKDTree, np.ndarray]]) -> np.ndarray:
    """Indices of the candidates that overlap a settled rock, or an earlier candidate."""
    tree = cKDTree(xy)
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
