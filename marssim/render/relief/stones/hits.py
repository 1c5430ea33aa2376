"""Which stone a piece of a ray meets, and where.

Over a short piece the ground between the stones is level, so that a ray is a line in x, y and height over the ground.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from marssim.base.compute.compiled import inlined
from marssim.render.relief.height import footprint_at, shown_at, stone_cover_at
from marssim.render.relief.stones.bodies import (
    AX,
    AY,
    BARE,
    BX,
    BY,
    CELLS,
    EAST,
    ENTRY_RANK,
    ENTRY_REACH,
    ENTRY_X,
    ENTRY_Y,
    GRAVEL,
    MIDDLE,
    NORTH,
    PER_SIDE,
    PLANES,
    RISE,
    SAND_STONES,
    SHAPE,
    SIDE,
    SIZE,
    TOP,
    TOPS,
)  # fmt: skip

STONE_NONE = 1.3  # pixels across a stone up to which it does not show
# pixels across it up to which it is flat, see flat.py, and from which on it has its height
STONE_FLAT, STONE_WHOLE = 3.0, 8.0
FLATTEST = 0.02  # least share of its height that a stone has which is not flat, so that rays find it


class Piece(NamedTuple):
    """A short piece of a ray over ground that is level between the stones.

    Attributes:
        x, y, z: Where it begins, world frame [m].
        over_ground: Its height over the ground there [m].
        dx, dy, d_over_ground: Growth of x, y and the height over the ground per unit of the piece.
        length: Of the piece, in the same unit.
    """

    x: float
    y: float
    z: float
    over_ground: float
    dx: float
    dy: float
    d_over_ground: float
    length: float


class StoneHit(NamedTuple):
    """A stone that a piece of a ray meets.

    Attributes:
        where: Where on the piece; the piece's length if it meets none.
        stone: Number of the stone, -1 for none.
        plane: Plane that the stone is entered by, -1 for its ellipsoid.
        lift: Share of its height that shows.
        x, y: Its centre, world frame [m].
    """

    where: float
    stone: np.int32
    plane: int
    lift: np.float32
    x: float
    y: float


class _Cell(NamedTuple):
    """A cell that a ray passes.

    Attributes:
        octave: Octave of its stones.
        entry: Number of the cell among those of all octaves.
        most: Rank up to which its stones may lie here.
        begin: Where on the piece the ray comes below the tops of the octave's stones.
        x, y: From the cell's corner to the ray at `begin`, in cells.
    """

    octave: int
    entry: np.uint32
    most: np.float32
    begin: float
    x: np.float32
    y: np.float32


@inlined
def _through_sphere(ox, oy, oz, dx, dy, dz):
    """Return where a ray enters and leaves the unit sphere; inf and -inf for a miss."""
    a = dx * dx + dy * dy + dz * dz
    b = ox * dx + oy * dy + oz * dz
    c = ox * ox + oy * oy + oz * oz - 1
    root = b * b - a * c
    if root <= 0:
        return np.inf, -np.inf
    root = math.sqrt(root)
    return (-b - root) / a, (-b + root) / a


@inlined
def _enter(ox, oy, oz, dx, dy, dz, planes, shape, ahead):
    """Return where a ray enters a unit sphere cut by planes, and the plane that it enters by (-1 for the sphere).

    Only what lies at 0 to `ahead` counts; inf for a miss.
    """
    first, last = _through_sphere(ox, oy, oz, dx, dy, dz)
    if first > ahead or last < 0:
        return np.inf, -1
    by = -1
    for n in range(PLANES):
        offset = planes[shape, n, 3]
        if offset >= 1:
            continue
        nx, ny, nz = planes[shape, n, 0], planes[shape, n, 1], planes[shape, n, 2]
        out = nx * ox + ny * oy + nz * oz - offset
        fall = nx * dx + ny * dy + nz * dz
        if fall == 0:
            if out > 0:
                return np.inf, -1
            continue
        where = -out / fall
        if fall < 0:
            if where > first:
                first, by = where, n
        elif where < last:
            last = where
    if first >= last or first < 0 or first > ahead:
        return np.inf, -1
    return first, by


@inlined
def tallest(octave, ranks, footprint):
    """Return the height of the largest stones that may lie here and have one in view [m]; 0 if none do.

    ranks: of most_stones.
    """
    for n in range(len(octave) - 1, -1, -1):
        if octave[n, SIDE] < np.float32(STONE_FLAT) * footprint:
            break
        if octave[n, BARE] * ranks[0] + octave[n, GRAVEL] * ranks[1] > 0:
            return octave[n, TOP]
    return np.float32(0)


@inlined
def most_stones(data, cover, x, y):
    """Return the greatest shares of bare ground's and of gravel's stones that may lie about x, y [m]."""
    sand, gravel = stone_cover_at(data, cover, np.float32(x), np.float32(y))
    open_ground = min(np.float32(1.15) - np.float32(SAND_STONES) * sand, np.float32(1))
    return open_ground, min(gravel + np.float32(0.15), np.float32(1)) if gravel > 0 else np.float32(0)


@inlined
def stone_hit(data, cover, stones, eye, focal, footprint, ranks, piece):
    """Return the StoneHit of the first stone that a piece of a ray meets.

    footprint: of pixels there [m]; ranks: of most_stones; piece: Piece.
    """
    summit, octave = stones.top, stones.octave
    x, y, _, g, dx, dy, dg, length = piece
    nearest = StoneHit(length, np.int32(-1), -1, np.float32(0), 0.0, 0.0)
    last = np.int32(CELLS - 1)
    per_x, per_y = 1 / max(abs(dx), 1e-12), 1 / max(abs(dy), 1e-12)
    per_g = 1 / dg if dg != 0 else 0.0
    step_i, step_j = np.int32(1 if dx > 0 else -1), np.int32(1 if dy > 0 else -1)
    level = 1 / math.sqrt(max(dx * dx + dy * dy, 1e-24))
    heading = np.float32(level * dx), np.float32(level * dy)
    for n in range(len(octave) - 1, -1, -1):
        cell = octave[n, SIDE]
        if cell < np.float32(STONE_FLAT) * footprint:
            break
        most = octave[n, BARE] * ranks[0] + octave[n, GRAVEL] * ranks[1]
        if most <= 0:
            continue
        top = octave[n, TOP]
        # the part of the piece below the stones' tops
        begin = 0.0 if g <= top else (top - g) * per_g if dg < 0 else np.inf
        limit = nearest.where if dg <= 0 else min(nearest.where, (top - g) * per_g)
        if begin >= limit:
            continue
        per_cell = octave[n, PER_SIDE]
        px, py = (x + begin * dx - octave[n, EAST]) * per_cell, (y + begin * dy - octave[n, NORTH]) * per_cell
        left, low = np.floor(px), np.floor(py)
        i, j = np.int32(left), np.int32(low)
        ahead_x, ahead_y = np.float32(px - left), np.float32(py - low)  # in cells, from the corner of the cell
        width_i, width_j = cell * per_x, cell * per_y
        next_i = begin + (1 - ahead_x if dx > 0 else ahead_x) * width_i
        next_j = begin + (1 - ahead_y if dy > 0 else ahead_y) * width_j
        travelled, first_cell, per_code = begin, n * (CELLS * CELLS + 1), top * np.float32(1 / TOPS)
        while travelled < min(limit, nearest.where):
            at = np.uint32(first_cell + (j & last) * CELLS + (i & last))
            lowest = g + dg * (travelled if dg > 0 else min(min(next_i, next_j), limit))
            if lowest < per_code * np.float32(summit[at]):
                place = _Cell(n, at, most, begin, ahead_x, ahead_y)
                nearest = _hit_in_cell(data, cover, stones, eye, focal, piece, heading, nearest, place)
            if next_i < next_j:
                travelled, next_i = next_i, next_i + width_i
                i, ahead_x = i + step_i, ahead_x - np.float32(step_i)
            else:
                travelled, next_j = next_j, next_j + width_j
                j, ahead_y = j + step_j, ahead_y - np.float32(step_j)
    return nearest


@inlined
def _hit_in_cell(data, cover, stones, eye, focal, piece, heading, nearest, place):
    """Return the StoneHit of a stone of a cell that a ray meets before `nearest`, else `nearest`.

    heading: the ray's direction as a unit vector x, y; place: _Cell.
    """
    first_entry, member, entries, stone, _, planes, octave = stones
    x, y, z, g, dx, dy, dg, _ = piece
    n, at, most, begin, ahead_x, ahead_y = place
    cell = octave[n, SIDE]
    for k in range(np.uint32(first_entry[at]), np.uint32(first_entry[at + 1])):
        if entries[k, ENTRY_RANK] > most:
            break
        # a ray that passes beside it, seen from above
        ox, oy = ahead_x - entries[k, ENTRY_X], ahead_y - entries[k, ENTRY_Y]
        if abs(ox * heading[1] - oy * heading[0]) > entries[k, ENTRY_REACH]:
            continue
        m = np.uint32(member[k])
        ox, oy = cell * ox - np.float32(begin * dx), cell * oy - np.float32(begin * dy)
        # a ray that passes by its ellipsoid, in which all that shows of it lies
        u, v = stone[m, AX] * ox + stone[m, AY] * oy, stone[m, BX] * ox + stone[m, BY] * oy
        du, dv = stone[m, AX] * dx + stone[m, AY] * dy, stone[m, BX] * dx + stone[m, BY] * dy
        rise = stone[m, RISE]
        enters, leaves = _through_sphere(u, v, (g - stone[m, MIDDLE]) * rise, du, dv, dg * rise)
        if enters > nearest.where or leaves < 0:
            continue
        sx, sy = x - ox, y - oy
        if not lies_there(data, cover, octave, n, entries[k, ENTRY_RANK], sx, sy):
            continue
        wide = footprint_at(eye, focal, sx, sy, z - g)
        if stone[m, SIZE] <= np.float32(STONE_FLAT) * wide:
            continue
        share = max(
            shown_at(stone[m, SIZE], wide, np.float32(STONE_FLAT), np.float32(STONE_WHOLE)),
            np.float32(FLATTEST),
        )
        rise /= share
        first, plane = _enter(
            u, v, (g - share * stone[m, MIDDLE]) * rise, du, dv, dg * rise,
            planes, np.int32(stone[m, SHAPE]), nearest.where,
        )  # fmt: skip
        if first < nearest.where:
            nearest = StoneHit(first, np.int32(m), plane, share, sx, sy)
    return nearest


@inlined
def lies_there(data, cover, octave, n, rank, x, y):
    """Return whether a stone of octave n lies on the ground at x, y [m], its centre, by its rank."""
    sand, gravel = stone_cover_at(data, cover, np.float32(x), np.float32(y))
    return rank <= octave[n, BARE] * (np.float32(1) - np.float32(SAND_STONES) * sand) + octave[n, GRAVEL] * gravel


@inlined
def stone_side(stones, hit, place):
    """Return how far a point is outside the side by which a stone is hit, and the slopes of that along the point.

    hit: StoneHit; place: x and y from the stone's centre, and height over the ground [m].
    """
    stone, m = stones.stone, hit.stone
    rise = stone[m, RISE] / hit.lift
    ax, ay, bx, by = stone[m, AX], stone[m, AY], stone[m, BX], stone[m, BY]
    u, v = ax * place[0] + ay * place[1], bx * place[0] + by * place[1]
    w = (place[2] - hit.lift * stone[m, MIDDLE]) * rise
    if hit.plane < 0:
        value = 0.5 * (u * u + v * v + w * w - 1)
        nu, nv, nw = u, v, w
    else:
        plane = stones.planes[np.int32(stone[m, SHAPE]), hit.plane]
        nu, nv, nw = plane[0], plane[1], plane[2]
        value = nu * u + nv * v + nw * w - plane[3]
    return value, nu * ax + nv * bx, nu * ay + nv * by, nw * rise
