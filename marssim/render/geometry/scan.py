"""Which triangle each of many rays hits, if all rays pass through one point or are parallel.

Rays from an eye, rays to the sun and rays to another eye are each one projection, in whose image plane a ray is a
point. The points need no raster: they are sorted into bins, and each triangle is tested against the bins that it covers
(an irregular z-buffer: Johnson et al. 2005, Aila and Laine 2004). The test of a point is that of its ray against the
triangle, in float64 and without gaps between neighbours. So the results are those of ray casting, but no acceleration
structure has to be built.
"""

from __future__ import annotations

import numpy as np

from marssim.base.compute.compiled import compiled, inlined
from marssim.base.dataset.frame import GROUND
from marssim.render.geometry.mesh import SceneMesh
from marssim.render.geometry.projection import Projection
from marssim.render.geometry.triangles import box_extent, corners, edges, extent, facing, meet

PER_BIN = 3.0  # mean number of points in a bin
SLACK = 1e-6  # margin around what a triangle covers, in bins, against rounding
BLOCK = 8  # bins along a side of a block: pieces of the mesh are tested against blocks


def obstacles(mesh: SceneMesh, view: Projection, x: np.ndarray, y: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Return where something hides points from the eye or the sun.

    Only faces of the ground that are turned away from it are tested: no point lies below the ground, so a ray that
    leaves the ground has entered it before.

    Args:
        mesh: The scene's mesh.
        view: Projection of the eye or the sun.
        x: (N,) image coordinates.
        y: (N,) image coordinates.
        s: (N,) S of the points, see projection.py.

    Returns:
        (N,) float64 S of a triangle in the way, any of them; inf where there is none.
    """
    face = _hit_faces(mesh, view, x, y, s, view.away)
    return _met_at(mesh.vertices, mesh.faces, face, view.numbers, x, y)


def nearest_faces(mesh: SceneMesh, view: Projection, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the face that each ray hits first, (N,) int32, -1 where it hits none. x, y: (N,) image points."""
    return _hit_faces(mesh, view, x, y, np.full(len(x), np.inf), 0.0)


def first_faces_of_rays(mesh: SceneMesh, rays: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Return the face that each ray of a camera hits first, (N,) int32, -1 where it hits none.

    Args:
        mesh: The mesh.
        rays: (N, 3) directions, camera frame, z = 1.
        pose: (4, 4) camera to world.
    """
    if len(rays) == 0:
        return np.zeros(0, dtype=np.int32)
    x, y = np.ascontiguousarray(rays[:, 0]), np.ascontiguousarray(rays[:, 1])
    return nearest_faces(mesh, Projection.of_eye(pose), x, y)


def _hit_faces(
    mesh: SceneMesh, view: Projection, x: np.ndarray, y: np.ndarray, limit: np.ndarray, away: float
) -> np.ndarray:
    """Return the face that each ray hits at an S below limit (N,), (N,) int32, -1 for none. away: see _scan."""
    bins = Bins(x, y)
    return _scan(
        mesh.vertices, mesh.faces, mesh.surface, mesh.start, mesh.low, mesh.high, view.numbers, view.nearest, away,
        bins.grid, bins.order, bins.start, bins.x, bins.y, limit,
    )  # fmt: skip


class Bins:
    """Points sorted into square bins of a warped image plane.

    Points are dense where the camera is near. The warp x -> x / (spread + |x|) about their middle evens them out; it is
    monotone, so boxes stay boxes.

    Attributes:
        grid: Middle x and y, spread, least warped x and y, bins per unit in x and y, number of bins along each axis.
        order: (N,) the points bin by bin.
        start: (bins + 1,) first point of each bin.
        x: (N,) image coordinates in that order.
        y: (N,) image coordinates in that order.
    """

    def __init__(self, x: np.ndarray, y: np.ndarray) -> None:
        some = slice(None, None, max(1, len(x) // 2048))
        middle = float(np.median(x[some])), float(np.median(y[some]))
        spread = float(np.median(np.maximum(np.abs(x[some] - middle[0]), np.abs(y[some] - middle[1])))) + 1e-9
        number = max(1, int(np.sqrt(len(x) / PER_BIN)))
        low_x, high_x, low_y, high_y = (
            _warped(value - centre, spread)
            for value, centre in (
                (x.min(), middle[0]), (x.max(), middle[0]), (y.min(), middle[1]), (y.max(), middle[1]),
            )
        )  # fmt: skip
        self.grid = (
            middle[0], middle[1], spread, low_x, low_y,
            number / max(high_x - low_x, 1e-12), number / max(high_y - low_y, 1e-12), number,
        )  # fmt: skip
        self.order, self.start, self.x, self.y = _sort(x, y, self.grid)


def _warped(offset, spread):
    return offset / (spread + abs(offset))


_warp = inlined(_warped)


@inlined
def _bin(value, middle, spread, low, scale, number):
    """Return the bin along one axis; values beyond the first or the last bin count as in that bin."""
    place = (_warp(value - middle, spread) - low) * scale
    return np.int32(min(max(place, 0.0), number - 1.0))


@compiled
def _sort(x, y, grid):
    mx, my, spread, lx, ly, sx, sy, number = grid
    n = len(x)
    bins = np.empty(n, dtype=np.int32)
    start = np.zeros(number * number + 1, dtype=np.int32)
    for k in range(n):
        bins[k] = _bin(y[k], my, spread, ly, sy, number) * number + _bin(x[k], mx, spread, lx, sx, number)
        start[bins[k] + 1] += 1
    for b in range(number * number):
        start[b + 1] += start[b]
    following = start[:-1].copy()
    order = np.empty(n, dtype=np.int32)
    sorted_x, sorted_y = np.empty(n), np.empty(n)
    for k in range(n):
        to = following[bins[k]]
        following[bins[k]] += 1
        order[to], sorted_x[to], sorted_y[to] = k, x[k], y[k]
    return order, start, sorted_x, sorted_y


@compiled
def block_reach(start, limit, number):
    """Return the largest limit of the points in each block of bins, (blocks, blocks), -inf without a point."""
    blocks = (number + BLOCK - 1) // BLOCK
    out = np.full((blocks, blocks), -np.inf)
    for row in range(number):
        for column in range(number):
            for k in range(start[row * number + column], start[row * number + column + 1]):
                if limit[k] > out[row // BLOCK, column // BLOCK]:
                    out[row // BLOCK, column // BLOCK] = limit[k]
    return out


@inlined
def bins_of(left, right, top, bottom, grid):
    """Return the first and last column and row of the bins in a part of the image plane; none if first > last."""
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
def farthest(left, right, top, bottom, grid, reach):
    """Return the largest limit of points in a part of the image plane, -inf if there is none. reach: of block_reach."""
    out = -np.inf
    i0, i1, j0, j1 = bins_of(left, right, top, bottom, grid)
    if i0 <= i1:
        for j in range(j0 // BLOCK, j1 // BLOCK + 1):
            for i in range(i0 // BLOCK, i1 // BLOCK + 1):
                out = max(out, reach[j, i])
    return out


@compiled
def _met_at(vertices, faces, face, view, x, y):
    """Return the S (N,) at which rays meet the faces (N,) that they are known to hit, inf where these are negative."""
    out = np.full(len(face), np.inf)
    for k in range(len(face)):
        if face[k] >= 0:
            a, b, c = corners(vertices, faces, face[k], view)
            out[k] = meet(edges(a, b, c)[0], x[k], y[k])
    return out


@compiled
def _scan(vertices, faces, surface, start, low, high, view, nearest, away, grid, order, bins, x, y, limit):
    """Return the face that each point's ray hits.

    away: 0 for the face that is hit first; else any face will do, but of the ground only one turned that way.
    """
    number = grid[7]
    limit = limit[order]
    nearest_face = np.full(len(x), -1, dtype=np.int32)
    reach = block_reach(bins, limit, number)
    for piece in range(len(start) - 1):
        left, right, top, bottom, first = box_extent(low[piece], high[piece], view)
        if not farthest(left, right, top, bottom, grid, reach) > first:
            continue
        for face in range(start[piece], start[piece + 1]):
            a, b, c = corners(vertices, faces, face, view)
            if away != 0 and surface[face] == GROUND and away * facing(a, b, c) <= 0:
                continue
            left, right, top, bottom = extent(a, b, c)
            i0, i1, j0, j1 = bins_of(left, right, top, bottom, grid)
            if i0 > i1:
                continue
            triangle, first = edges(a, b, c)
            for j in range(j0, j1 + 1):
                for k in range(bins[j * number + i0], bins[j * number + i1 + 1]):
                    if limit[k] > first:
                        s = meet(triangle, x[k], y[k])
                        if nearest < s < limit[k]:
                            limit[k] = s if away == 0 else -np.inf
                            nearest_face[k] = face
    out = np.empty(len(x), dtype=np.int32)
    for k in range(len(x)):
        out[order[k]] = nearest_face[k]
    return out
