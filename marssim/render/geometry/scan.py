"""Which triangle each of many rays meets, when all rays meet in one point or are parallel.

Rays from an eye, rays to the sun and rays to another eye are each one projection, and in the image plane of that
projection a ray is a point. The points need no raster: they are sorted into bins, and each triangle looks only into the
bins that it covers (an irregular z-buffer: Johnson et al. 2005, Aila and Laine 2004). The test of a point against a
triangle is that of a ray against it, in float64 and without gaps between neighbours, so the answers are those of ray
casting; nothing has to be built per scene.
"""

from __future__ import annotations

import numpy as np

from marssim.base.compute.compiled import compiled, inlined
from marssim.base.dataset.frame import GROUND
from marssim.render.geometry.mesh import SceneMesh
from marssim.render.geometry.projection import Projection
from marssim.render.geometry.triangles import box_extent, corners, edges, extent, facing, meet

PER_BIN = 3.0  # points a bin, on average
SLACK = 1e-6  # bins about what a triangle covers, against rounding
BLOCK = 8  # bins along a block: pieces of the mesh are held against blocks


def unobstructed(mesh: SceneMesh, view: Projection, x: np.ndarray, y: np.ndarray, s: np.ndarray) -> np.ndarray:
    """(N,) bool: does no triangle stand before the points? x, y: (N,) in the image plane, s: (N,).

    Of the ground only what is turned away from the eye or sun: no point lies below it, so that a ray which leaves it
    has entered it.
    """
    return _met(mesh, view, x, y, s, view.away) < 0


def nearest_faces(mesh: SceneMesh, view: Projection, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(N,) int32 index of the face that each ray meets first, -1 where there is none. x, y: (N,) image points."""
    return _met(mesh, view, x, y, np.full(len(x), np.inf), 0.0)


def _met(mesh: SceneMesh, view: Projection, x: np.ndarray, y: np.ndarray, limit: np.ndarray, away: float) -> np.ndarray:
    """(N,) int32 index of the face that each ray meets at an S below limit (N,), -1: none. away: see _scan."""
    bins = _Bins(x, y)
    return _scan(
        mesh.vertices, mesh.faces, mesh.surface, mesh.start, mesh.low, mesh.high, view.numbers, view.nearest, away,
        bins.grid, bins.order, bins.start, bins.x, bins.y, limit,
    )  # fmt: skip


class _Bins:
    """Points sorted into square bins of a warped image plane.

    Points crowd where the camera is near; x -> x / (spread + |x|) about their middle evens them out, and as it is
    monotone, boxes stay boxes. order: (N,) the points bin by bin; start: (bins + 1,) first of each bin; x, y in order.
    grid: middle x, y, spread, low and bins per unit in each warped axis, number of bins in each.
    """

    def __init__(self, x: np.ndarray, y: np.ndarray) -> None:
        some = slice(None, None, max(1, len(x) // 2048))
        middle = float(np.median(x[some])), float(np.median(y[some]))
        spread = float(np.median(np.maximum(np.abs(x[some] - middle[0]), np.abs(y[some] - middle[1])))) + 1e-9
        number = max(1, int(np.sqrt(len(x) / PER_BIN)))
        low_x, high_x, low_y, high_y = (
            _warp(value - centre, spread)
            for value, centre in (
                (x.min(), middle[0]), (x.max(), middle[0]), (y.min(), middle[1]), (y.max(), middle[1]),
            )
        )  # fmt: skip
        self.grid = (
            middle[0], middle[1], spread, low_x, low_y,
            number / max(high_x - low_x, 1e-12), number / max(high_y - low_y, 1e-12), number,
        )  # fmt: skip
        self.order, self.start, self.x, self.y = _sort(x, y, self.grid)


@inlined
def _warp(offset, spread):
    return offset / (spread + abs(offset))


@inlined
def _bin(value, middle, spread, low, scale, number):
    """The bin along one axis; values beyond the first and the last one are counted to these."""
    place = (_warp(value - middle, spread) - low) * scale
    return np.int32(min(max(place, 0.0), number - 1.0))


@compiled
def _sort(x, y, grid):
    mx, my, spread, lx, ly, sx, sy, number = grid
    n = len(x)
    of = np.empty(n, dtype=np.int32)
    start = np.zeros(number * number + 1, dtype=np.int32)
    for k in range(n):
        of[k] = _bin(y[k], my, spread, ly, sy, number) * number + _bin(x[k], mx, spread, lx, sx, number)
        start[of[k] + 1] += 1
    for b in range(number * number):
        start[b + 1] += start[b]
    place = start[:-1].copy()
    order = np.empty(n, dtype=np.int32)
    sorted_x, sorted_y = np.empty(n), np.empty(n)
    for k in range(n):
        to = place[of[k]]
        place[of[k]] += 1
        order[to], sorted_x[to], sorted_y[to] = k, x[k], y[k]
    return order, start, sorted_x, sorted_y


@compiled
def _block_reach(start, limit, number):
    """(blocks, blocks) largest limit of the points in each block of bins, -inf where there is none."""
    blocks = (number + BLOCK - 1) // BLOCK
    out = np.full((blocks, blocks), -np.inf)
    for row in range(number):
        for column in range(number):
            for k in range(start[row * number + column], start[row * number + column + 1]):
                if limit[k] > out[row // BLOCK, column // BLOCK]:
                    out[row // BLOCK, column // BLOCK] = limit[k]
    return out


@inlined
def _bins(left, right, top, bottom, grid):
    """First and last column, first and last row of the bins in a part of the image plane: none if first > last."""
    mx, my, spread, lx, ly, sx, sy, number = grid
    if left == np.inf:
        return np.int32(0), np.int32(-1), np.int32(0), np.int32(-1)
    if left == -np.inf:
        return np.int32(0), np.int32(number - 1), np.int32(0), np.int32(number - 1)
    i0, i1 = (_warp(left - mx, spread) - lx) * sx - SLACK, (_warp(right - mx, spread) - lx) * sx + SLACK
    j0, j1 = (_warp(top - my, spread) - ly) * sy - SLACK, (_warp(bottom - my, spread) - ly) * sy + SLACK
    if i1 < 0 or j1 < 0 or i0 > number or j0 > number:
        return np.int32(0), np.int32(-1), np.int32(0), np.int32(-1)
    last = number - 1.0
    return np.int32(max(i0, 0.0)), np.int32(min(i1, last)), np.int32(max(j0, 0.0)), np.int32(min(j1, last))


@compiled
def _in_the_way(low, high, view, grid, reach):
    """May a box stand before any point? reach: of _block_reach."""
    left, right, top, bottom, first = box_extent(low, high, view)
    i0, i1, j0, j1 = _bins(left, right, top, bottom, grid)
    if i0 > i1:
        return False
    for j in range(j0 // BLOCK, j1 // BLOCK + 1):
        for i in range(i0 // BLOCK, i1 // BLOCK + 1):
            if reach[j, i] > first:
                return True
    return False


@compiled
def _scan(vertices, faces, surface, start, low, high, view, nearest, away, grid, order, bins, x, y, limit):
    """Return the face that each point's ray hits.

    away: 0 for the face that is hit first; else any face will do, but of the ground only one turned that way.
    """
    number = grid[7]
    limit = limit[order]
    found = np.full(len(x), -1, dtype=np.int32)
    reach = _block_reach(bins, limit, number)
    for piece in range(len(start) - 1):
        if not _in_the_way(low[piece], high[piece], view, grid, reach):
            continue
        for face in range(start[piece], start[piece + 1]):
            a, b, c = corners(vertices, faces, face, view)
            if away != 0 and surface[face] == GROUND and away * facing(a, b, c) <= 0:
                continue
            left, right, top, bottom = extent(a, b, c)
            i0, i1, j0, j1 = _bins(left, right, top, bottom, grid)
            if i0 > i1:
                continue
            triangle, first = edges(a, b, c)
            for j in range(j0, j1 + 1):
                for k in range(bins[j * number + i0], bins[j * number + i1 + 1]):
                    if limit[k] > first:
                        met = meet(triangle, x[k], y[k])
                        if nearest < met < limit[k]:
                            limit[k] = met if away == 0 else -np.inf
                            found[k] = face
    out = np.empty(len(x), dtype=np.int32)
    for k in range(len(x)):
        out[order[k]] = found[k]
    return out
