"""Which stone a piece of a ray meets, and where.

Over a short piece the ground between the stones is level, so that a ray is a line in x, y and height over the ground.
"""

from __future__ import annotations

import math

import numpy as np

from marssim.base.compute.compiled import inlined
from marssim.render.relief.height import cover_at, footprint_at, shown_at
from marssim.render.relief.stones import (
    AX,
    AY,
    BARE,
    BX,
    BY,
    CELLS,
    EAST,
    GRAVEL,
    MIDDLE,
    NORTH,
    PER_SIDE,
    PLANES,
    RANK,
    REACH,
    RISE,
    SAND_STONES,
    SHAPE,
    SIDE,
    SIZE,
    TOP,
    X,
    Y,
)  # fmt: skip

STONE_NONE = 1.3  # pixels across a stone up to which it does not show
STONE_FLAT, STONE_WHOLE = 2.0, 8.0  # pixels up to which it is flat, a pattern, and from which on it has its height
FLATTEST = 0.02  # share of its height that even a flat stone has, so that rays find it


@inlined
def _enter(ox, oy, oz, dx, dy, dz, planes, shape, ahead):
    """Return where a ray enters a unit sphere cut by planes, and the plane that it enters by (-1 for the sphere).

    Only what lies at 0 to `ahead` counts; inf for a miss.
    """
    a = dx * dx + dy * dy + dz * dz
    b = ox * dx + oy * dy + oz * dz
    c = ox * ox + oy * oy + oz * oz - 1
    root = b * b - a * c
    if root <= 0:
        return np.inf, -1
    root = math.sqrt(root)
    first, last, by = (-b - root) / a, (-b + root) / a, -1
    if first > ahead or last < 0:
        return np.inf, -1
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
def tallest(octave, open_ground, packed, footprint):
    """Return the height over the ground of the largest stones that may lie here and show [m]; 0 if none do."""
    for n in range(len(octave) - 1, -1, -1):
        if octave[n, SIDE] < np.float32(STONE_NONE) * footprint:
            break
        if octave[n, BARE] * open_ground + octave[n, GRAVEL] * packed > 0:
            return octave[n, TOP]
    return np.float32(0)


@inlined
def most_stones(data, cover, x, y):
    """Return the greatest shares of bare ground's and of gravel's stones that may lie about x, y [m]."""
    sand, _, _, gravel, _ = cover_at(data, cover, np.float32(x), np.float32(y))
    open_ground = min(np.float32(1.15) - np.float32(SAND_STONES) * sand, np.float32(1))
    return open_ground, min(gravel + np.float32(0.15), np.float32(1)) if gravel > 0 else np.float32(0)


@inlined
def stone_hit(
    data, cover, start, member, stone, planes, octave, eye, focal, footprint, open_ground, packed,
    x, y, z, g, dx, dy, dg, length,
):  # fmt: skip
    """Return the first stone that a piece of a ray meets.

    footprint: of pixels there [m]; open_ground, packed: of most_stones; x, y, z, g: where the piece begins, world
    frame [m], and its height over the ground; dx, dy, dg: their growth per unit of the piece; length: of the piece.
    Returns where on the piece, the stone (-1 for none), the plane that it is entered by, the share of its height that
    shows, and its centre x, y in the world.
    """
    best, who, by, lift, cx, cy = length, -1, -1, np.float32(0), 0.0, 0.0
    last = np.int32(CELLS - 1)
    per_x, per_y = 1 / max(abs(dx), 1e-12), 1 / max(abs(dy), 1e-12)
    per_g = 1 / dg if dg != 0 else 0.0
    step_i, step_j = np.int32(1 if dx > 0 else -1), np.int32(1 if dy > 0 else -1)
    aside_most = dx * dx + dy * dy
    for n in range(len(octave) - 1, -1, -1):
        cell = octave[n, SIDE]
        if cell < np.float32(STONE_NONE) * footprint:
            break
        most = octave[n, BARE] * open_ground + octave[n, GRAVEL] * packed
        if most <= 0:
            continue
        top = octave[n, TOP]
        # the part of the piece below the stones' tops
        begin = 0.0 if g <= top else (top - g) * per_g if dg < 0 else np.inf
        limit = best if dg <= 0 else min(best, (top - g) * per_g)
        if begin >= limit:
            continue
        per_cell = octave[n, PER_SIDE]
        px, py = (x + begin * dx - octave[n, EAST]) * per_cell, (y + begin * dy - octave[n, NORTH]) * per_cell
        left, low = np.floor(px), np.floor(py)
        i, j = np.int32(left), np.int32(low)
        width_i, width_j = cell * per_x, cell * per_y
        next_i = begin + (1 - px + left if dx > 0 else px - left) * width_i
        next_j = begin + (1 - py + low if dy > 0 else py - low) * width_j
        here, first_cell = begin, n * (CELLS * CELLS + 1)
        while here < min(limit, best):
            at = first_cell + (j & last) * CELLS + (i & last)
            for entry in range(start[at], start[at + 1]):
                m = member[entry]
                if stone[m, RANK] > most:
                    break
                # the tile's copy that is nearest to the cell
                sx, sy = stone[m, X], stone[m, Y]
                sx += cell * (CELLS * np.floor((i + 0.5 - sx * per_cell) * (1 / CELLS) + 0.5)) + octave[n, EAST]
                sy += cell * (CELLS * np.floor((j + 0.5 - sy * per_cell) * (1 / CELLS) + 0.5)) + octave[n, NORTH]
                ox, oy = x - sx, y - sy
                # a ray that passes beside it, seen from above
                aside, reach = ox * dy - oy * dx, stone[m, REACH]
                if aside * aside > reach * reach * aside_most:
                    continue
                sand, _, _, gravel, _ = cover_at(data, cover, np.float32(sx), np.float32(sy))
                share = octave[n, BARE] * (1 - np.float32(SAND_STONES) * sand) + octave[n, GRAVEL] * gravel
                if stone[m, RANK] > share:
                    continue
                wide = footprint_at(eye, focal, sx, sy, z - g)
                if stone[m, SIZE] <= np.float32(STONE_NONE) * wide:
                    continue
                share = max(
                    shown_at(stone[m, SIZE], wide, np.float32(STONE_FLAT), np.float32(STONE_WHOLE)),
                    np.float32(FLATTEST),
                )
                rise = stone[m, RISE] / share
                first, plane = _enter(
                    stone[m, AX] * ox + stone[m, AY] * oy, stone[m, BX] * ox + stone[m, BY] * oy,
                    (g - share * stone[m, MIDDLE]) * rise,
                    stone[m, AX] * dx + stone[m, AY] * dy, stone[m, BX] * dx + stone[m, BY] * dy, dg * rise,
                    planes, np.int32(stone[m, SHAPE]), best,
                )  # fmt: skip
                if first < best:
                    best, who, by, lift, cx, cy = first, m, plane, share, sx, sy
            if next_i < next_j:
                here, i, next_i = next_i, i + step_i, next_i + width_i
            else:
                here, j, next_j = next_j, j + step_j, next_j + width_j
    return best, who, by, lift, cx, cy


@inlined
def stone_side(stone, planes, m, by, lift, ox, oy, g):
    """Return how far a point is outside a stone's side, and its slopes along x, y and height over the ground.

    ox, oy: from the stone's centre [m]; g: height over the ground [m]; by: plane, or -1 for the ellipsoid.
    """
    rise = stone[m, RISE] / lift
    ax, ay, bx, by_ = stone[m, AX], stone[m, AY], stone[m, BX], stone[m, BY]
    u, v, w = ax * ox + ay * oy, bx * ox + by_ * oy, (g - lift * stone[m, MIDDLE]) * rise
    if by < 0:
        value = 0.5 * (u * u + v * v + w * w - 1)
        nu, nv, nw = u, v, w
    else:
        n = np.int32(stone[m, SHAPE])
        nu, nv, nw = planes[n, by, 0], planes[n, by, 1], planes[n, by, 2]
        value = nu * u + nv * v + nw * w - planes[n, by, 3]
    return value, nu * ax + nv * bx, nu * ay + nv * by_, nw * rise
