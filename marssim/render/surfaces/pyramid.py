"""A periodic tile at all resolutions, each half of the one before, so that a pixel shows the mean of what it covers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from marssim.base.compute.compiled import compiled, inlined
from marssim.render.surfaces.bilinear import bilinear_weights

CODES = 127  # code of the largest value of a channel
CHANNELS = 5  # slopes along x and y, and three others


class PlacedTile(NamedTuple):
    """A tile laid on a surface, as kernels take it.

    Attributes:
        codes: (M, CHANNELS) int8, of `pyramid`.
        cosine: float32 cosine of the tile's rotation.
        sine: float32 sine of the tile's rotation.
        offset: float32 offset along both axes [texels].
    """

    codes: np.ndarray
    cosine: np.float32
    sine: np.float32
    offset: np.float32


@compiled
def pyramid(finest):
    """Return all levels of a tile, each half as fine as the one before, one after another: (M, CHANNELS) int8.

    finest: (N, N, CHANNELS) finest level in codes; N is a power of two.
    """
    side = len(finest)
    total, size = 0, side
    while size >= 1:
        total += size * size
        size //= 2
    out = np.empty((total, CHANNELS), dtype=np.int8)
    level = finest
    at = 0
    while True:
        size = len(level)
        for j in range(size):
            for i in range(size):
                for c in range(CHANNELS):
                    out[at, c] = np.int8(np.rint(level[j, i, c]))
                at += 1
        if size == 1:
            return out
        half = np.empty((size // 2, size // 2, CHANNELS), dtype=np.float32)
        for j in range(size // 2):
            for i in range(size // 2):
                for c in range(CHANNELS):
                    a, b = level[2 * j, 2 * i, c], level[2 * j, 2 * i + 1, c]
                    half[j, i, c] = np.float32(0.25) * (
                        a + b + level[2 * j + 1, 2 * i, c] + level[2 * j + 1, 2 * i + 1, c]
                    )
        level = half


@inlined
def pyramid_at(placed, side, texel, u, v, footprint):
    """Return the channels in codes at surface coordinates u, v [m]; the first two, slopes, are turned to u and v.

    placed: PlacedTile; side: texels along a side of its finest level; texel: their size [m]; footprint: width of a
    pixel on the surface [m].
    """
    scale = np.float32(1 / texel)
    tile, cosine, sine = placed.codes, placed.cosine, placed.sine
    x = (cosine * u - sine * v) * scale + placed.offset
    y = (sine * u + cosine * v) * scale + placed.offset
    size, start, spread = side, 0, footprint * scale
    one, half = np.float32(1), np.float32(0.5)
    while spread > one and size > 1:
        start += size * size
        size >>= 1
        spread *= half
        x = x * half - np.float32(0.25)
        y = y * half - np.float32(0.25)
    # blend the level whose texels are at least as wide as the pixel with the finer level before it
    along, across, third, fourth, fifth = _bilinear(tile, start, size, x, y)
    if start > 0:
        fine = max(np.float32(2) * (one - spread), np.float32(0))  # a pixel wider than the tile sees its mean
        two = np.float32(2)
        a, b, c, d, e = _bilinear(tile, start - 4 * size * size, 2 * size, two * x + half, two * y + half)
        along += fine * (a - along)
        across += fine * (b - across)
        third += fine * (c - third)
        fourth += fine * (d - fourth)
        fifth += fine * (e - fifth)
    return cosine * along + sine * across, cosine * across - sine * along, third, fourth, fifth


@inlined
def _bilinear(tile, start, size, x, y):
    left, top = np.floor(x), np.floor(y)
    s, t = x - left, y - top
    i, j = np.int32(left) & np.int32(size - 1), np.int32(top) & np.int32(size - 1)
    i2, j2 = (i + np.int32(1)) & np.int32(size - 1), (j + np.int32(1)) & np.int32(size - 1)
    p, q = np.uint32(start + j * size + i), np.uint32(start + j * size + i2)
    r, w = np.uint32(start + j2 * size + i), np.uint32(start + j2 * size + i2)
    a, b, c, d = bilinear_weights(s, t)
    return (
        a * tile[p, 0] + b * tile[q, 0] + c * tile[r, 0] + d * tile[w, 0],
        a * tile[p, 1] + b * tile[q, 1] + c * tile[r, 1] + d * tile[w, 1],
        a * tile[p, 2] + b * tile[q, 2] + c * tile[r, 2] + d * tile[w, 2],
        a * tile[p, 3] + b * tile[q, 3] + c * tile[r, 3] + d * tile[w, 3],
        a * tile[p, 4] + b * tile[q, 4] + c * tile[r, 4] + d * tile[w, 4],
    )
