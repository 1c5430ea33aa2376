"""Which triangle each of many rays meets, when all rays meet in one point or are parallel.

Rays from an eye, rays to the sun and rays to another eye are each one projection, and in the image plane of that
projection a ray is a point. The points need no raster: they are sorted into bins, and each triangle looks only into the
bins that it covers (an irregular z-buffer: Johnson et al. 2005, Aila and Laine 2004). The test of a point against a
triangle is that of a ray against it, in float64 and without gaps between neighbours, so the answers are those of ray
casting; nothing has to be built per scene.
"""

from __future__ import annotations

import numpy as np

from marssim.compiled import compiled
from marssim.render.gbuffer import GROUND
from marssim.render.mesh import SceneMesh
from marssim.render.projection import NEAREST, Projection

PER_BIN = 3.0  # points a bin, on average
BLOCK = 8  # bins along a block: pieces of the mesh are held against blocks


def blocked(mesh: SceneMesh, view: Projection, x: np.ndarray, y: np.ndarray, s: np.ndarray) -> np.ndarray:
    """(N,) bool: does a triangle stand before the points? x, y: (N,) in the image plane, s: (N,).

    Of the ground only what is turned away from the eye or sun: no point lies below it, so that a ray which leaves it
    has entered it.
    """
    bins = _Bins(x, y)
    limit = s[bins.order]
    out = np.zeros(len(x), dtype=bool)
    out[bins.order] = _scan_blocked(
        mesh.vertices, mesh.faces, mesh.surface, mesh.start, mesh.low, mesh.high, view.axes, view.shift, view.nearest,
        view.away, bins.grid, bins.start, bins.x, bins.y, limit,
    )  # fmt: skip
    return out


def nearest(mesh: SceneMesh, view: Projection, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(N,) int32 index of the face that each ray meets first, -1 where there is none. x, y: (N,) image points."""
    bins = _Bins(x, y)
    out = np.empty(len(x), dtype=np.int32)
    out[bins.order] = _scan_nearest(
        mesh.vertices, mesh.faces, mesh.start, mesh.low, mesh.high, view.axes, view.shift, view.nearest,
        bins.grid, bins.start, bins.x, bins.y,
    )  # fmt: skip
    return out


def matching(
    mesh: SceneMesh, view: Projection, x: np.ndarray, y: np.ndarray, s: np.ndarray, surface: np.ndarray
) -> np.ndarray:
    """(N,) int32 index of the face of surface (N,) that the ray meets nearest to S = s (N,), -1 where there is none."""
    bins = _Bins(x, y)
    out = np.empty(len(x), dtype=np.int32)
    out[bins.order] = _scan_matching(
        mesh.vertices, mesh.faces, mesh.surface, mesh.start, mesh.low, mesh.high, view.axes, view.shift, view.nearest,
        bins.grid, bins.start, bins.x, bins.y, s[bins.order], surface[bins.order],
    )  # fmt: skip
    return out


class _Bins:
    """Points sorted into square bins of a warped image plane.

    Points crowd where the camera is near; x -> x / (spread + |x|) about their middle evens them out, and as it is
    monotone, boxes stay boxes. order: (N,) the points bin by bin; start: (bins + 1,) first of each bin; x, y in order.
    grid: middle x, y, spread, low and bins per unit in each warped axis, number of bins in each.
    """

    def __init__(self, x: np.ndarray, y: np.ndarray) -> None:
        x, y = np.ascontiguousarray(x, dtype=float), np.ascontiguousarray(y, dtype=float)
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


@compiled
def _warp(offset: float, spread: float) -> float:
    return offset / (spread + abs(offset))


@compiled
def _bin(value, middle, spread, low, scale, number):
    """The bin along one axis; values beyond the first and the last one are counted to these."""
    place = (_warp(value - middle, spread) - low) * scale
    return int(min(max(place, 0.0), number - 1.0))


@compiled
def _sort(x, y, grid):
    mx, my, spread, lx, ly, sx, sy, number = grid
    n = len(x)
    of = np.empty(n, dtype=np.int32)
    start = np.zeros(number * number + 1, dtype=np.int64)
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


@compiled
def _in_the_way(low, high, axes, shift, nearest, grid, reach):
    """May a box stand before any point?"""
    mx, my, spread, lx, ly, sx, sy, number = grid
    left, right, top, bottom = np.inf, -np.inf, np.inf, -np.inf
    first, front, behind = np.inf, False, False
    for corner in range(8):
        px = high[0] if corner & 1 else low[0]
        py = high[1] if corner & 2 else low[1]
        pz = high[2] if corner & 4 else low[2]
        w = axes[2, 0] * px + axes[2, 1] * py + axes[2, 2] * pz + shift[2]
        first = min(first, axes[3, 0] * px + axes[3, 1] * py + axes[3, 2] * pz + shift[3])
        if w < NEAREST:
            behind = True
            continue
        front = True
        u = (axes[0, 0] * px + axes[0, 1] * py + axes[0, 2] * pz + shift[0]) / w
        v = (axes[1, 0] * px + axes[1, 1] * py + axes[1, 2] * pz + shift[1]) / w
        left, right, top, bottom = min(left, u), max(right, u), min(top, v), max(bottom, v)
    if not front:
        return False
    if behind:
        left, right, top, bottom = -np.inf, np.inf, -np.inf, np.inf
    if left > _unwarp(number, lx, sx, mx, spread) or right < _unwarp(0, lx, sx, mx, spread):
        return False
    if top > _unwarp(number, ly, sy, my, spread) or bottom < _unwarp(0, ly, sy, my, spread):
        return False
    i0, i1 = 0, number - 1
    j0, j1 = 0, number - 1
    if not behind:
        i0, i1 = _bin(left, mx, spread, lx, sx, number), _bin(right, mx, spread, lx, sx, number)
        j0, j1 = _bin(top, my, spread, ly, sy, number), _bin(bottom, my, spread, ly, sy, number)
    for j in range(j0 // BLOCK, j1 // BLOCK + 1):
        for i in range(i0 // BLOCK, i1 // BLOCK + 1):
            if reach[j, i] > first:
                return True
    return False


@compiled
def _unwarp(place, low, scale, middle, spread):
    """Image coordinate at the border of a bin, with a little slack outwards."""
    warped = place / scale + low
    slack = 1e-9 if place > 0 else -1e-9
    return middle + spread * warped / (1 - abs(warped)) + slack * (1 + abs(middle) + spread)


@compiled
def _corners(vertices, faces, face, axes, shift, q):
    """Project a triangle to q (3, 4)."""
    for c in range(3):
        v = faces[face, c]
        px, py, pz = vertices[v, 0], vertices[v, 1], vertices[v, 2]
        for r in range(4):
            q[c, r] = axes[r, 0] * px + axes[r, 1] * py + axes[r, 2] * pz + shift[r]


@compiled
def _covers(q, grid, box):
    """The bins of a projected triangle, box i0, i1, j0, j1; False if no point can lie in it."""
    mx, my, spread, lx, ly, sx, sy, number = grid
    inside = 0
    for c in range(3):
        if q[c, 2] >= NEAREST:
            inside += 1
    if inside == 0:
        return False
    left, right, top, bottom = np.inf, -np.inf, np.inf, -np.inf
    for c in range(3):
        w = q[c, 2]
        if w >= NEAREST:
            u, v = q[c, 0] / w, q[c, 1] / w
            left, right, top, bottom = min(left, u), max(right, u), min(top, v), max(bottom, v)
        if inside < 3:
            d = (c + 1) % 3
            other = q[d, 2]
            if (w >= NEAREST) != (other >= NEAREST):
                t = (NEAREST - w) / (other - w)
                u = (q[c, 0] + t * (q[d, 0] - q[c, 0])) / NEAREST
                v = (q[c, 1] + t * (q[d, 1] - q[c, 1])) / NEAREST
                slack = 1e-6 * (abs(u) + abs(v))
                left, right = min(left, u - slack), max(right, u + slack)
                top, bottom = min(top, v - slack), max(bottom, v + slack)
    i0 = (_warp(left - mx, spread) - lx) * sx
    i1 = (_warp(right - mx, spread) - lx) * sx
    j0 = (_warp(top - my, spread) - ly) * sy
    j1 = (_warp(bottom - my, spread) - ly) * sy
    if i1 < -1e-6 or j1 < -1e-6 or i0 > number + 1e-6 or j0 > number + 1e-6:
        return False
    last = number - 1.0
    box[0], box[1] = int(min(max(i0 - 1e-6, 0.0), last)), int(min(max(i1 + 1e-6, 0.0), last))
    box[2], box[3] = int(min(max(j0 - 1e-6, 0.0), last)), int(min(max(j1 + 1e-6, 0.0), last))
    return True


@compiled
def _edges(q, e):
    """The three edge functions of the triangle, e[c] . (x, y, 1), that of corner c's opposite edge."""
    for c in range(3):
        a, b = (c + 1) % 3, (c + 2) % 3
        e[c, 0] = q[a, 1] * q[b, 2] - q[a, 2] * q[b, 1]
        e[c, 1] = q[a, 2] * q[b, 0] - q[a, 0] * q[b, 2]
        e[c, 2] = q[a, 0] * q[b, 1] - q[a, 1] * q[b, 0]


@compiled
def _meet(e, q, x, y):
    """S where the ray meets the triangle, inf where it passes by. Edges belong to both neighbours."""
    w0 = e[0, 0] * x + e[0, 1] * y + e[0, 2]
    w1 = e[1, 0] * x + e[1, 1] * y + e[1, 2]
    if w0 * w1 < 0:
        return np.inf
    w2 = e[2, 0] * x + e[2, 1] * y + e[2, 2]
    if w0 * w2 < 0 or w1 * w2 < 0:
        return np.inf
    total = w0 + w1 + w2
    if total == 0:
        return np.inf
    return (w0 * q[0, 3] + w1 * q[1, 3] + w2 * q[2, 3]) / total


@compiled
def _scan_blocked(
    vertices, faces, surface, start, low, high, axes, shift, nearest, away, grid, bins, x, y, limit
):  # fmt: skip
    number = grid[7]
    out = np.zeros(len(x), dtype=np.bool_)
    q, e, box = np.empty((3, 4)), np.empty((3, 3)), np.empty(4, dtype=np.int64)
    reach = _block_reach(bins, limit, number)
    for piece in range(len(start) - 1):
        if not _in_the_way(low[piece], high[piece], axes, shift, nearest, grid, reach):
            continue
        for face in range(start[piece], start[piece + 1]):
            _corners(vertices, faces, face, axes, shift, q)
            _edges(q, e)
            facing = away * (e[0, 0] * q[0, 0] + e[0, 1] * q[0, 1] + e[0, 2] * q[0, 2])
            if facing <= 0 and surface[face] == GROUND:
                continue
            if not _covers(q, grid, box):
                continue
            first = min(q[0, 3], q[1, 3], q[2, 3])
            for j in range(box[2], box[3] + 1):
                for k in range(bins[j * number + box[0]], bins[j * number + box[1] + 1]):
                    if limit[k] > first and not out[k]:
                        s = _meet(e, q, x[k], y[k])
                        if nearest < s < limit[k]:
                            out[k] = True
    return out


@compiled
def _scan_nearest(vertices, faces, start, low, high, axes, shift, nearest, grid, bins, x, y):
    number = grid[7]
    out = np.full(len(x), -1, dtype=np.int32)
    best = np.full(len(x), np.inf)
    q, e, box = np.empty((3, 4)), np.empty((3, 3)), np.empty(4, dtype=np.int64)
    reach = _block_reach(bins, best, number)
    for piece in range(len(start) - 1):
        if not _in_the_way(low[piece], high[piece], axes, shift, nearest, grid, reach):
            continue
        for face in range(start[piece], start[piece + 1]):
            _corners(vertices, faces, face, axes, shift, q)
            if not _covers(q, grid, box):
                continue
            _edges(q, e)
            first = min(q[0, 3], q[1, 3], q[2, 3])
            for j in range(box[2], box[3] + 1):
                for k in range(bins[j * number + box[0]], bins[j * number + box[1] + 1]):
                    if best[k] > first:
                        s = _meet(e, q, x[k], y[k])
                        if nearest < s < best[k]:
                            best[k] = s
                            out[k] = face
    return out


@compiled
def _scan_matching(
    vertices, faces, surface, start, low, high, axes, shift, nearest, grid, bins, x, y, guess, wanted
):  # fmt: skip
    number = grid[7]
    out = np.full(len(x), -1, dtype=np.int32)
    off = np.full(len(x), np.inf)
    q, e, box = np.empty((3, 4)), np.empty((3, 3)), np.empty(4, dtype=np.int64)
    reach = _block_reach(bins, off, number)
    for piece in range(len(start) - 1):
        if not _in_the_way(low[piece], high[piece], axes, shift, nearest, grid, reach):
            continue
        for face in range(start[piece], start[piece + 1]):
            _corners(vertices, faces, face, axes, shift, q)
            if not _covers(q, grid, box):
                continue
            _edges(q, e)
            for j in range(box[2], box[3] + 1):
                for k in range(bins[j * number + box[0]], bins[j * number + box[1] + 1]):
                    if wanted[k] == surface[face]:
                        s = _meet(e, q, x[k], y[k])
                        if s > nearest and abs(s - guess[k]) < off[k]:
                            off[k] = abs(s - guess[k])
                            out[k] = face
    return out
