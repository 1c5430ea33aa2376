"""World-space noise filtered by pixel footprint: the grain of ground and rock, equal for both eyes.

One band-limited tile of noise is sampled at several scales. Each octave fades out as its wavelength falls under the
width of a pixel on the ground, so that nothing shimmers and the two views of one point agree.
"""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np

TILE = 512  # texels on a side of the periodic tile
TEXELS = 8.0  # texels per wavelength in the tile
ROW = 512  # points handled as rows of an image: cv2.remap takes images, and none of more than 32767 columns


@lru_cache(maxsize=4)
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


def octave_weight(wavelength: float, footprint: np.ndarray) -> np.ndarray:
    """How much of an octave a pixel shows: 1 where it is well resolved, 0 at two pixels a wavelength and below.

    footprint: (N,) width of a pixel on the surface [m]. Returns (N,) float32.
    """
    # linear in the ratio instead of its logarithm: as smooth, and far cheaper
    ramp = np.clip((wavelength / np.maximum(footprint, 1e-9) - 2) * (1 / 3.5), 0, 1)
    return (ramp * ramp * (3 - 2 * ramp)).astype(np.float32)


def sample_octave(uv: np.ndarray, wavelength: float, seed: int, octave: int, slopes: bool = True) -> np.ndarray:
    """Noise of one wavelength at surface coordinates.

    uv: (N, 2) float32 [m]. Returns (N, 3) float32: value, slope along u, slope along v, each of unit variance; or
    (N, 1), the value alone.
    """
    rng = np.random.default_rng((seed, octave))
    angle = rng.uniform(0, 2 * np.pi)
    c, s = np.cos(angle), np.sin(angle)
    offset = rng.uniform(0, TILE, 2)
    rows = -(-len(uv) // ROW)
    turn = np.array([[c, s], [-s, c]], dtype=np.float32) * np.float32(TEXELS / wavelength)
    texel = np.zeros((rows * ROW, 2), dtype=np.float32)
    texel[: len(uv), 0] = uv[:, 0] * turn[0, 0] + uv[:, 1] * turn[1, 0]
    texel[: len(uv), 1] = uv[:, 0] * turn[0, 1] + uv[:, 1] * turn[1, 1]
    texel += offset.astype(np.float32)
    texel -= np.floor(texel * np.float32(1 / TILE)) * np.float32(TILE)
    tile = noise_tile(seed) if slopes else _value_tile(seed)
    where = texel.reshape(rows, ROW, 2)
    value = cv2.remap(tile, where[..., 0], where[..., 1], cv2.INTER_LINEAR)
    out = value.reshape(rows * ROW, -1)[: len(uv)]
    if slopes:
        along, across = out[:, 1].copy(), out[:, 2]
        out[:, 1] = np.float32(c) * along + np.float32(s) * across
        out[:, 2] = np.float32(-s) * along + np.float32(c) * across
    return out


@lru_cache(maxsize=4)
def _value_tile(seed: int) -> np.ndarray:
    return np.ascontiguousarray(noise_tile(seed)[..., 0])


def fractal(
    uv: np.ndarray,
    footprint: np.ndarray,
    wavelengths: np.ndarray,
    value: np.ndarray,
    slope: np.ndarray | None,
    seed: int,
) -> tuple[np.ndarray, np.ndarray | None]:
    """Sum of octaves.

    uv: (N, 2) [m]; footprint: (N,) [m]; wavelengths: (M,) [m]; value, slope: (M,) amplitude of the value and of the
    slope in each octave, slope None if no slopes are wanted.
    Returns the value (N,) and the slopes along u and v (N, 2) or None, float32.
    """
    uv = np.ascontiguousarray(uv, dtype=np.float32)
    footprint = footprint.astype(np.float32)
    total = np.zeros(len(uv), dtype=np.float32)
    slopes = None if slope is None else np.zeros((len(uv), 2), dtype=np.float32)
    for octave, wavelength in enumerate(wavelengths):
        weight = octave_weight(float(wavelength), footprint)
        near = np.flatnonzero(weight)
        if len(near) == 0:
            continue
        part: slice | np.ndarray = slice(None) if len(near) > 0.9 * len(uv) else near
        noise = sample_octave(uv[part], float(wavelength), seed, octave, slope is not None)
        total[part] += (np.float32(value[octave]) * weight[part]) * noise[:, 0]
        if slopes is not None and slope is not None:
            slopes[part] += (np.float32(slope[octave]) * weight[part])[:, None] * noise[:, 1:]
    return total, slopes
