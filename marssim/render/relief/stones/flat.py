"""Stones that are too small in view to have a height: a pattern on the ground."""

from __future__ import annotations

import math

import numpy as np

from marssim.base.compute.compiled import inlined
from marssim.render.relief.height import shown_at
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

STONE_SEEN = 2.0  # pixels across a stone from which on it shows fully


@inlined
def flat_stone(data, cover, stones, footprint, x, y):
    """Return the stone without a height that covers most of a pixel, -1 for none, and the share that it covers.

    footprint: width of the pixel on the ground [m]; x, y: its middle on the ground [m].
    """
    start, member, entries, stone, _, _, octave = stones
    last = np.int32(CELLS - 1)
    who, covered = np.int32(-1), np.float32(0)
    open_ground, packed = most_stones(data, cover, x, y)
    for n in range(len(octave)):
        cell = octave[n, SIDE]
        if cell > np.float32(2 * STONE_FLAT) * footprint:
            break
        most = octave[n, BARE] * open_ground + octave[n, GRAVEL] * packed
        if most <= 0 or cell < np.float32(STONE_NONE) * footprint:
            continue
        per_cell = octave[n, PER_SIDE]
        px, py = (x - octave[n, EAST]) * per_cell, (y - octave[n, NORTH]) * per_cell
        left, low = np.floor(px), np.floor(py)
        i, j = np.int32(left), np.int32(low)
        ahead_x, ahead_y = px - left, py - low
        at = n * (CELLS * CELLS + 1) + (j & last) * CELLS + (i & last)
        for k in range(np.uint32(start[at]), np.uint32(start[at + 1])):
            if entries[k, ENTRY_RANK] > most:
                break
            ox, oy, reach = ahead_x - entries[k, ENTRY_X], ahead_y - entries[k, ENTRY_Y], entries[k, ENTRY_REACH]
            if ox * ox + oy * oy > reach * reach:
                continue
            m = np.uint32(member[k])
            size = stone[m, SIZE]
            if not np.float32(STONE_NONE) * footprint < size <= np.float32(STONE_FLAT) * footprint:
                continue
            ox, oy = cell * ox, cell * oy
            u, v = stone[m, AX] * ox + stone[m, AY] * oy, stone[m, BX] * ox + stone[m, BY] * oy
            sunk = stone[m, MIDDLE] * stone[m, RISE]
            inside = math.sqrt(max(np.float32(1) - sunk * sunk, np.float32(0))) - math.sqrt(u * u + v * v)
            # its rim is blurred over a pixel
            share = min(np.float32(0.5) * inside * size / footprint, np.float32(1))
            share *= shown_at(size, footprint, np.float32(STONE_NONE), np.float32(STONE_SEEN))
            if share > covered and lies_there(data, cover, octave, n, entries[k, ENTRY_RANK], x - ox, y - oy):
                who, covered = np.int32(m), share
    return who, covered
