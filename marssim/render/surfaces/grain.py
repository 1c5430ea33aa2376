"""World-space noise filtered by pixel footprint: the grain of ground and rock, equal for both eyes.

One band-limited tile of noise is sampled at several scales. Each octave fades out as its wavelength falls under the
width of a pixel on the ground, so that nothing shimmers and the two views of one point agree.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy.fft

from marssim.base.compute.compiled import inlined
from marssim.render.surfaces.bilinear import bilinear_weights

TILE = 512  # texels on a side of the periodic tile
TEXELS = 8.0  # texels per wavelength in the tile
STEP = 1 / 4096  # of the coded noise; one is a standard deviation


class Octaves(NamedTuple):
    """Noise of M wavelengths on a surface, as kernels take it.

    tile: of coded_tile; places: (M, 7) of placing; amplitude, slope: (M,) float32 standard deviation of each octave,
    and of its slope.
    """

    tile: np.ndarray
    places: np.ndarray
    amplitude: np.ndarray
    slope: np.ndarray


def noise_tile(seed: int, slopes: bool = True) -> np.ndarray:
    """(TILE + 1, TILE + 1, 3) float32: band-limited noise of unit variance and its two slopes, of unit variance.

    Periodic; the first row and column stand again at the end, for interpolation. Without slopes, (..., 1) of the same.
    """
    rng = np.random.default_rng(seed)
    across, down = scipy.fft.rfftfreq(TILE)[None, :].astype(np.float32), scipy.fft.fftfreq(TILE)[:, None]
    down = down.astype(np.float32)
    k = np.hypot(down, across) * np.float32(TEXELS)
    octaves = np.log2(np.maximum(k, np.float32(1e-9)))
    noise = rng.standard_normal((TILE, TILE)).astype(np.float32)
    spectrum = scipy.fft.rfft2(noise) * (np.exp(-0.5 * (octaves / np.float32(0.42)) ** 2) / (k + np.float32(1e-9)))
    spectrum[0, 0] = 0
    # the slopes are scaled to unit variance, so that of their factor, 2 pi i k, the number does not matter
    parts = (spectrum, 1j * spectrum * across, 1j * spectrum * down) if slopes else (spectrum,)
    out = np.empty((TILE + 1, TILE + 1, len(parts)), dtype=np.float32)
    for channel, part in enumerate(parts):
        field = scipy.fft.irfft2(part, s=(TILE, TILE))
        out[:-1, :-1, channel] = field / field.std()
    out[-1], out[:, -1] = out[0], out[:, 0]
    return out


@lru_cache(maxsize=16)
def coded_tile(seed: int, slopes: bool = True) -> np.ndarray:
    """noise_tile in int16 steps of STEP, so that it fits the cache; (TILE + 1, TILE + 1, 1) without its slopes."""
    return np.clip(np.rint(noise_tile(seed, slopes) / np.float32(STEP)), -32768, 32767).astype(np.int16)


@lru_cache(maxsize=32)
def placing(wavelengths: tuple[float, ...], seed: int) -> np.ndarray:
    """(M, 7) float32 of each octave: wavelength [m], cosine and sine of its turn, offset u, v [texels], drawn from the
    seed, and cosine and sine times the texels per metre."""
    rows = []
    for octave, wavelength in enumerate(wavelengths):
        rng = np.random.default_rng((seed, octave))
        angle = rng.uniform(0, 2 * np.pi)
        cosine, sine, scale = np.cos(angle), np.sin(angle), TEXELS / wavelength
        rows.append([wavelength, cosine, sine, *rng.uniform(0, TILE, 2), scale * cosine, scale * sine])
    return np.array(rows, dtype=np.float32)


# inlined, as all that is called for each pixel: a call counts references to its arrays, which costs more than its sums
@inlined
def octave_weight(wavelength, footprint):
    """How much of an octave a pixel shows: 1 where it is well resolved, 0 at two pixels a wavelength and below.

    footprint: width of a pixel on the surface [m]. Like all that follows, float32 if its arguments are.
    """
    # linear in the ratio instead of its logarithm: as smooth, and far cheaper
    ramp = (wavelength / max(footprint, np.float32(1e-9)) - np.float32(2)) * np.float32(1 / 3.5)
    ramp = min(max(ramp, np.float32(0)), np.float32(1))
    return ramp * ramp * (np.float32(3) - np.float32(2) * ramp)


@inlined
def _texel(places, octave, u, v):
    """Where a surface point lies in the tile: index of the texel before it, and the rest, along x and y."""
    # single precision, as the tile. On ground, at 100 m and the finest octave, it is off by 0.004 texels at most. On
    # rock n the caller moves u and v by 0.37 n, so that the finest octave is off by 0.01 texels at the median of rock
    # 1,000 and by 0.14, up to a whole one, on rock 12,000: a sixtieth to an eighth of its wavelength. High numbers are
    # rocks of few pixels
    x = places[octave, 5] * u - places[octave, 6] * v + places[octave, 3]
    y = places[octave, 6] * u + places[octave, 5] * v + places[octave, 4]
    left, top = np.floor(x), np.floor(y)
    column, row = np.int32(left) & np.int32(TILE - 1), np.int32(top) & np.int32(TILE - 1)
    return np.uint32(column), np.uint32(row), x - left, y - top


@inlined
def octave_value(tile, places, octave, u, v):
    """Noise of one octave, of unit variance, at surface coordinates u, v [m]. tile, places: of Octaves."""
    i, j, s, t = _texel(places, octave, u, v)
    right, below = i + np.uint32(1), j + np.uint32(1)
    a, b, c, d = bilinear_weights(s, t)
    value = a * tile[j, i, 0] + b * tile[j, right, 0] + c * tile[below, i, 0] + d * tile[below, right, 0]
    return value * np.float32(STEP)


@inlined
def octave_slopes(tile, places, octave, u, v):
    """Noise of one octave and its slopes along u and v, each of unit variance. tile, places: of Octaves."""
    i, j, s, t = _texel(places, octave, u, v)
    right, below = i + np.uint32(1), j + np.uint32(1)
    a, b, c, d = bilinear_weights(s, t)
    value = a * tile[j, i, 0] + b * tile[j, right, 0] + c * tile[below, i, 0] + d * tile[below, right, 0]
    along = a * tile[j, i, 1] + b * tile[j, right, 1] + c * tile[below, i, 1] + d * tile[below, right, 1]
    across = a * tile[j, i, 2] + b * tile[j, right, 2] + c * tile[below, i, 2] + d * tile[below, right, 2]
    turn_u, turn_v = places[octave, 1] * np.float32(STEP), places[octave, 2] * np.float32(STEP)
    return value * np.float32(STEP), turn_u * along + turn_v * across, -turn_v * along + turn_u * across


@inlined
def fractal_slopes(noise, u, v, footprint):
    """Sum of the Octaves `noise` at surface coordinates u, v [m], and its slopes along u and v. footprint [m]."""
    tile, places, amplitude, slope = noise  # taken apart once: each look into a tuple counts references, too
    total, du, dv = np.float32(0), np.float32(0), np.float32(0)
    for octave in range(len(places)):
        weight = octave_weight(places[octave, 0], footprint)
        if weight > 0:
            value, along, across = octave_slopes(tile, places, octave, u, v)
            steep = weight * slope[octave]
            total += weight * amplitude[octave] * value
            du += steep * along
            dv += steep * across
    return total, du, dv
