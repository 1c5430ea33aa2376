"""How high the stones on the ground reach, on a grid."""

from __future__ import annotations

import math

import numpy as np

from marssim.base.compute.compiled import compiled
from marssim.render.relief.height import stone_cover_at
from marssim.render.relief.stones.bodies import (
    BARE,
    CELLS,
    EAST,
    GRAVEL,
    MIDDLE,
    NORTH,
    RANK,
    REACH,
    RISE,
    SAND_STONES,
    SIDE,
    SIZE,
    X,
    Y,
)  # fmt: skip


@compiled
def raise_at_stones(data, cover, stone, octave, least, x0, y0, cell, tops):
    """Raise the nodes of a grid to the heights over the ground of the stones in the cells beside them.

    Args:
        data: Of Ground.
        cover: Of Relief.
        stone: Of Stones.
        octave: Of Stones.
        least: Diameter from which on stones count [m].
        x0: East coordinate of the first node [m].
        y0: North coordinate of the first node [m].
        cell: Spacing of the nodes [m].
        tops: (ny, nx) heights [m], raised in place.
    """
    ny, nx = tops.shape
    one = np.float32(1)
    for m in range(len(stone)):
        size = stone[m, SIZE]
        if size < least:
            continue
        n = 0
        while octave[n, SIDE] < size:
            n += 1
        bare, gravel_share = octave[n, BARE], octave[n, GRAVEL]
        rank, reach = stone[m, RANK], stone[m, REACH]
        if rank > bare + gravel_share:
            continue
        top = one / stone[m, RISE] + stone[m, MIDDLE]
        period = CELLS * octave[n, SIDE]
        px, py = stone[m, X] + octave[n, EAST], stone[m, Y] + octave[n, NORTH]
        px -= period * math.floor((px - x0) / period)
        py -= period * math.floor((py - y0) / period)
        y = py
        while y < y0 + ny * cell:
            x = px
            while x < x0 + nx * cell:
                sand, gravel = stone_cover_at(data, cover, np.float32(x), np.float32(y))
                if rank <= bare * (one - np.float32(SAND_STONES) * sand) + gravel_share * gravel:
                    i0, i1 = int((x - reach - x0) / cell), int((x + reach - x0) / cell) + 1
                    j0, j1 = int((y - reach - y0) / cell), int((y + reach - y0) / cell) + 1
                    for j in range(max(j0, 0), min(j1 + 1, ny)):
                        for i in range(max(i0, 0), min(i1 + 1, nx)):
                            tops[j, i] = max(tops[j, i], top)
                x += period
            y += period
