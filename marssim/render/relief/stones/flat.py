"""Stones that are too small in view to have a height: a pattern on the ground."""

from __future__ import annotations

import numpy as np

from marssim.base.compute.compiled import inlined
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
    RISE,
    SIDE,
    SIZE,
)  # fmt: skip
from marssim.render.relief.stones.hits import STONE_FLAT, STONE_NONE, lies_there, most_stones


@inlined
def flat_stone(data, cover, stones, footprint, x, y):
    """Return the stone without height that lies at a point of the ground, -1 for none.

    footprint: width of a pixel there [m]; x, y: the point [m]. The largest stone there counts.
    """
    start, member, entries, stone, _, octave = stones
    last = np.int32(CELLS - 1)
    open_ground, packed = most_stones(data, cover, x, y)
    for n in range(len(octave) - 1, -1, -1):
        cell = octave[n, SIDE]
        if cell < np.float32(STONE_NONE) * footprint:
            break
        most = octave[n, BARE] * open_ground + octave[n, GRAVEL] * packed
        if most <= 0 or cell > np.float32(2 * STONE_FLAT) * footprint:
            continue
        per_cell = octave[n, PER_SIDE]
        px, py = (x - octave[n, EAST]) * per_cell, (y - octave[n, NORTH]) * per_cell
        left, low = np.floor(px), np.floor(py)
        i, j = np.int32(left), np.int32(low)
        ahead_x, ahead_y = np.float32(px - left), np.float32(py - low)
        at = n * (CELLS * CELLS + 1) + (j & last) * CELLS + (i & last)
        for k in range(np.uint32(start[at]), np.uint32(start[at + 1])):
            if entries[k, ENTRY_RANK] > most:
                break
            ox, oy, reach = ahead_x - entries[k, ENTRY_X], ahead_y - entries[k, ENTRY_Y], entries[k, ENTRY_REACH]
            if ox * ox + oy * oy > reach * reach:
                continue
            m = np.uint32(member[k])
            if not np.float32(STONE_NONE) * footprint < stone[m, SIZE] <= np.float32(STONE_FLAT) * footprint:
                continue
            ox, oy = cell * ox, cell * oy
            u, v = stone[m, AX] * ox + stone[m, AY] * oy, stone[m, BX] * ox + stone[m, BY] * oy
            sunk = stone[m, MIDDLE] * stone[m, RISE]
            if u * u + v * v + sunk * sunk > 1:
                continue
            if lies_there(data, cover, octave, n, entries[k, ENTRY_RANK], x - ox, y - oy):
                return np.int32(m)
    return np.int32(-1)
