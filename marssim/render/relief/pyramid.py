"""A periodic pattern at all resolutions, each half of the one before: a pixel shows the mean of what it covers."""

from __future__ import annotations

import numpy as np

from marssim.base.compute.compiled import compiled, inlined
from marssim.scene.ground.bilinear import bilinear_weights

CODES = 127  # code of the largest value of a channel
CHANNELS = 2


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
def pyramid_at(codes, placed, x, y, footprint):
    """Return both channels in codes, float32, at world x, y [m].

    codes: of `pyramid`; placed: the Tile whose nodes are the finest level's texels; footprint: width of a pixel on the
    surface [m].
    """
    _, size, _, spacing, cosine, sine, offset = placed
    one, half, two = np.float32(1), np.float32(0.5), np.float32(2)
    scale = one / spacing
    u, v = (cosine * x - sine * y) * scale + offset, (sine * x + cosine * y) * scale + offset
    start, spread = np.int32(0), footprint * scale
    while spread > one and size > 1:
        start += size * size
        size >>= np.int32(1)
        spread *= half
        u, v = u * half - np.float32(0.25), v * half - np.float32(0.25)
    # blend the level whose texels are at least as wide as the pixel with the finer level before it
    first, second = _bilinear(codes, start, size, u, v)
    if start > 0:
        fine = max(two * (one - spread), np.float32(0))  # a pixel wider than the tile sees its mean
        finer = size << np.int32(1)
        a, b = _bilinear(codes, start - finer * finer, finer, two * u + half, two * v + half)
        first, second = first + fine * (a - first), second + fine * (b - second)
    return first, second


@inlined
def _bilinear(codes, start, size, u, v):
    left, low = np.floor(u), np.floor(v)
    one, mask = np.int32(1), size - np.int32(1)
    i, j = np.int32(left) & mask, np.int32(low) & mask
    i2, j2 = (i + one) & mask, (j + one) & mask
    p, q = np.uint32(start + j * size + i), np.uint32(start + j * size + i2)
    r, w = np.uint32(start + j2 * size + i), np.uint32(start + j2 * size + i2)
    a, b, c, d = bilinear_weights(u - left, v - low)
    return (
        a * codes[p, 0] + b * codes[q, 0] + c * codes[r, 0] + d * codes[w, 0],
        a * codes[p, 1] + b * codes[q, 1] + c * codes[r, 1] + d * codes[w, 1],
    )
