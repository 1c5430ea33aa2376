"""World-space noise filtered by pixel footprint: the grain of ground and rock, equal for both eyes.

One band-limited tile of noise is sampled at several scales. Each octave fades out as its wavelength falls under the
width of a pixel on the ground, so that nothing shimmers and the two views of one point agree.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numba import njit

TILE = 512  # texels on a side of the periodic tile
TEXELS = 8.0  # texels per wavelength in the tile


@lru_cache(maxsize=8)
def noise_tile(seed: int) -> np.ndarray:
    """(TILE + 1, TILE + 1, 3) float32: band-limited noise of unit variance and its two slopes, of unit variance.

    Periodic; the first row and column stand again at the end, for interpolation.
    """
    rng = np.random.default_rng(seed)
    k = np.hypot(np.fft.fftfreq(TILE)[:, None], np.fft.rfftfreq(TILE)[None, :]) * TEXELS
    octaves = np.log2(np.maximum(k, 1e-9))
    spectrum = np.fft.rfft2(rng.standard_normal((TILE, TILE))) * np.exp(-0.5 * (octaves / 0.42) ** 2) / (k + 1e-9)
    spectrum[0, 0] = 0
    slope_y = spectrum * 2j * np.pi * np.fft.fftfreq(TILE)[:, None]
    slope_x = spectrum * 2j * np.pi * np.fft.rfftfreq(TILE)[None, :]
    tile = np.stack([np.fft.irfft2(part, s=(TILE, TILE)) for part in (spectrum, slope_x, slope_y)], axis=-1)
    tile /= tile.std(axis=(0, 1))
    return np.pad(tile, ((0, 1), (0, 1), (0, 0)), mode="wrap").astype(np.float32)


@lru_cache(maxsize=8)
def value_tile(seed: int) -> np.ndarray:
    """(TILE + 1, TILE + 1) float32: the noise of noise_tile without its slopes, a third of the memory to go through."""
    return np.ascontiguousarray(noise_tile(seed)[..., 0])


@lru_cache(maxsize=32)
def placing(wavelengths: tuple[float, ...], seed: int) -> np.ndarray:
    """(M, 5) of each octave: wavelength [m], cosine and sine of its turn, offset u, v [texels], drawn from the seed."""
    rows = []
    for octave, wavelength in enumerate(wavelengths):
        rng = np.random.default_rng((seed, octave))
        angle = rng.uniform(0, 2 * np.pi)
        rows.append([wavelength, np.cos(angle), np.sin(angle), *rng.uniform(0, TILE, 2)])
    return np.array(rows)


@njit(cache=True, error_model="numpy")
def octave_weight(wavelength: float, footprint: float) -> float:
    """How much of an octave a pixel shows: 1 where it is well resolved, 0 at two pixels a wavelength and below.

    footprint: width of a pixel on the surface [m].
    """
    # linear in the ratio instead of its logarithm: as smooth, and far cheaper
    ramp = min(max((wavelength / max(footprint, 1e-9) - 2) * (1 / 3.5), 0.0), 1.0)
    return ramp * ramp * (3 - 2 * ramp)


@njit(cache=True, error_model="numpy", inline="always")
def _texel(places, octave, u, v):
    """Where a surface point lies in the tile: index of the texel before it, and the rest, along x and y."""
    scale = TEXELS / places[octave, 0]
    x = scale * (places[octave, 1] * u - places[octave, 2] * v) + places[octave, 3]
    y = scale * (places[octave, 2] * u + places[octave, 1] * v) + places[octave, 4]
    i, j = math.floor(x), math.floor(y)
    return i & (TILE - 1), j & (TILE - 1), np.float32(x - i), np.float32(y - j)


@njit(cache=True, error_model="numpy")
def octave_value(tile, places, octave, u, v):
    """Noise of one octave at surface coordinates u, v [m]. tile: of value_tile; places: (M, 5) of placing."""
    i, j, s, t = _texel(places, octave, u, v)
    top = tile[j, i] + s * (tile[j, i + 1] - tile[j, i])
    low = tile[j + 1, i] + s * (tile[j + 1, i + 1] - tile[j + 1, i])
    return top + t * (low - top)


@njit(cache=True, error_model="numpy")
def octave_slopes(tile, places, octave, u, v):
    """Noise of one octave and its slopes along u and v, each of unit variance. tile: of noise_tile."""
    i, j, s, t = _texel(places, octave, u, v)
    b, c = s - s * t, t - s * t
    d = s * t
    a = np.float32(1) - s - c
    value = a * tile[j, i, 0] + b * tile[j, i + 1, 0] + c * tile[j + 1, i, 0] + d * tile[j + 1, i + 1, 0]
    along = a * tile[j, i, 1] + b * tile[j, i + 1, 1] + c * tile[j + 1, i, 1] + d * tile[j + 1, i + 1, 1]
    across = a * tile[j, i, 2] + b * tile[j, i + 1, 2] + c * tile[j + 1, i, 2] + d * tile[j + 1, i + 1, 2]
    turn_u, turn_v = places[octave, 1], places[octave, 2]
    return value, turn_u * along + turn_v * across, -turn_v * along + turn_u * across


@njit(cache=True, error_model="numpy")
def fractal_value(tile, places, amplitude, u, v, footprint):
    """Sum of octaves at a point. places: (M, 5) of placing; amplitude: (M,); footprint [m]."""
    total = 0.0
    for octave in range(len(places)):
        weight = octave_weight(places[octave, 0], footprint)
        if weight > 0:
            total += weight * amplitude[octave] * octave_value(tile, places, octave, u, v)
    return total


@njit(cache=True, error_model="numpy")
def fractal_slopes(tile, places, amplitude, slope, u, v, footprint):
    """Sum of octaves at a point and its slopes along u and v; amplitude, slope: (M,) of each octave."""
    total, du, dv = 0.0, 0.0, 0.0
    for octave in range(len(places)):
        weight = octave_weight(places[octave, 0], footprint)
        if weight > 0:
            value, along, across = octave_slopes(tile, places, octave, u, v)
            total += weight * amplitude[octave] * value
            du += weight * slope[octave] * along
            dv += weight * slope[octave] * across
    return total, du, dv
