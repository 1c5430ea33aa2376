"""Noise in world coordinates, filtered by pixel footprint: the grain of ground and rock, equal for both cameras.

One band-limited tile of noise is sampled at several scales. Each octave fades out as its wavelength approaches the
width of a pixel on the ground. So nothing shimmers, and the two views of a point agree.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy.fft

from marssim.base.compute.compiled import inlined
from marssim.scene.ground.bilinear import bilinear_weights

TILE = 512  # texels on a side of the periodic tile
TEXELS = 8.0  # texels per wavelength in the tile
WIDTH = 0.65  # [octaves] standard deviation of the band of wavelengths; in a narrower one, noise looks like scales
STEP = 1 / 4096  # step of the coded noise, in standard deviations


class Octaves(NamedTuple):
    """Noise of M wavelengths on a surface, as kernels take it.

    Attributes:
        tile: The noise, of `coded_tile`.
        places: (M, 7) placing of each octave, of `placing`.
        amplitude: (M,) float32 standard deviation of each octave.
        slope: (M,) float32 standard deviation of each octave's slope.
    """

    tile: np.ndarray
    places: np.ndarray
    amplitude: np.ndarray
    slope: np.ndarray


def noise_tile(seed: int, slopes: bool = True) -> np.ndarray:
    """Draw a periodic tile of band-limited noise.

    Args:
        seed: Seed of the noise.
        slopes: Include the slopes of the noise.

    Returns:
        (TILE + 1, TILE + 1, 3) float32: the noise and its two slopes, of unit variance each; (..., 1) without slopes.
        The first row and column are repeated at the end, for interpolation.
    """
    rng = np.random.default_rng(seed)
    across, down = scipy.fft.rfftfreq(TILE)[None, :].astype(np.float32), scipy.fft.fftfreq(TILE)[:, None]
    down = down.astype(np.float32)
    k = np.hypot(down, across) * np.float32(TEXELS)
    octaves = np.log2(np.maximum(k, np.float32(1e-9)))
    noise = rng.standard_normal((TILE, TILE)).astype(np.float32)
    spectrum = scipy.fft.rfft2(noise) * (np.exp(-0.5 * (octaves / np.float32(WIDTH)) ** 2) / (k + np.float32(1e-9)))
    spectrum[0, 0] = 0
    # the slopes are scaled to unit variance later, so the constant in their factor 2 pi i k does not matter
    parts = (spectrum, 1j * spectrum * across, 1j * spectrum * down) if slopes else (spectrum,)
    out = np.empty((TILE + 1, TILE + 1, len(parts)), dtype=np.float32)
    for channel, part in enumerate(parts):
        field = scipy.fft.irfft2(part, s=(TILE, TILE))
        out[:-1, :-1, channel] = field / field.std()
    out[-1], out[:, -1] = out[0], out[:, 0]
    return out


@lru_cache(maxsize=16)
def coded_tile(seed: int, slopes: bool = True) -> np.ndarray:
    """Return `noise_tile` as int16 in steps of STEP, so that it fits the CPU's cache."""
    return np.clip(np.rint(noise_tile(seed, slopes) / np.float32(STEP)), -32768, 32767).astype(np.int16)


@lru_cache(maxsize=32)
def placing(wavelengths: tuple[float, ...], seed: int) -> np.ndarray:
    """Draw how the octaves of M wavelengths [m] lie on a surface.

    Returns:
        (M, 7) float32: wavelength [m], cosine and sine of the rotation, offset u and v [texels], and cosine and sine
        times the texels per metre.
    """
    rows = []
    for octave, wavelength in enumerate(wavelengths):
        rng = np.random.default_rng((seed, octave))
        angle = rng.uniform(0, 2 * np.pi)
        cosine, sine, scale = np.cos(angle), np.sin(angle), TEXELS / wavelength
        rows.append([wavelength, cosine, sine, *rng.uniform(0, TILE, 2), scale * cosine, scale * sine])
    return np.array(rows, dtype=np.float32)


# inlined like everything that runs for each pixel: a call counts references to its arrays, which takes longer than it
@inlined
def octave_weight(wavelength, footprint):
    """Return how much of an octave a pixel shows: 1 where it is well resolved, 0 below two pixels a wavelength.

    wavelength [m]; footprint: width of a pixel on the surface [m]. As in all functions below, float32 stays float32.
    """
    # linear in the ratio instead of its logarithm: equally smooth, and far cheaper
    ramp = (wavelength / max(footprint, np.float32(1e-9)) - np.float32(2)) * np.float32(1 / 3.5)
    ramp = min(max(ramp, np.float32(0)), np.float32(1))
    return ramp * ramp * (np.float32(3) - np.float32(2) * ramp)


@inlined
def _texel(places, octave, u, v):
    """Return where a surface point lies in the tile: the texel before it, and the remainder, along x and y."""
    # In single precision, as the tile. On ground at 100 m, the finest octave is off by at most 0.004 texels. On rock n
    # the caller moves u and v by 0.37 n m: the finest octave is off by a median of 0.01 texels on rock 1,000, and by
    # 0.14 and up to one texel on rock 12,000, a sixtieth to an eighth of its wavelength. Rocks of high number show few
    # pixels.
    x = places[octave, 5] * u - places[octave, 6] * v + places[octave, 3]
    y = places[octave, 6] * u + places[octave, 5] * v + places[octave, 4]
    left, top = np.floor(x), np.floor(y)
    column, row = np.int32(left) & np.int32(TILE - 1), np.int32(top) & np.int32(TILE - 1)
    return np.uint32(column), np.uint32(row), x - left, y - top


@inlined
def octave_value(tile, places, octave, u, v):
    """Return the noise of one octave, of unit variance, at surface coordinates u, v [m]. tile, places: of Octaves."""
    i, j, s, t = _texel(places, octave, u, v)
    right, below = i + np.uint32(1), j + np.uint32(1)
    a, b, c, d = bilinear_weights(s, t)
    value = a * tile[j, i, 0] + b * tile[j, right, 0] + c * tile[below, i, 0] + d * tile[below, right, 0]
    return value * np.float32(STEP)


@inlined
def octave_slopes(tile, places, octave, u, v):
    """Return the noise of one octave and its slopes along u and v, of unit variance each. tile, places: of Octaves."""
    i, j, s, t = _texel(places, octave, u, v)
    right, below = i + np.uint32(1), j + np.uint32(1)
    a, b, c, d = bilinear_weights(s, t)
    value = a * tile[j, i, 0] + b * tile[j, right, 0] + c * tile[below, i, 0] + d * tile[below, right, 0]
    along = a * tile[j, i, 1] + b * tile[j, right, 1] + c * tile[below, i, 1] + d * tile[below, right, 1]
    across = a * tile[j, i, 2] + b * tile[j, right, 2] + c * tile[below, i, 2] + d * tile[below, right, 2]
    turn_u, turn_v = places[octave, 1] * np.float32(STEP), places[octave, 2] * np.float32(STEP)
    return value * np.float32(STEP), turn_u * along + turn_v * across, -turn_v * along + turn_u * across
