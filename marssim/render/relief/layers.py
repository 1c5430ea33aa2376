"""The tiles of fine relief: self-affine roughness, ripples of the wind, plates of bedrock. Made once, then shared."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import scipy.fft

from marssim.render.relief.tiles import tile_levels
from marssim.scene.ground.noise import TEXELS, TILE

FRACTAL = (512, 0.00875, 6)  # nodes along a side, spacing [m], levels
GRAIN = (512, 0.002, 3)
FRACTAL_WAVES, GRAIN_WAVES = (0.03, 0.4), (0.008, 0.03)  # [m] shortest and longest waves
SLOPE, SLOPE_AT, SLOPE_FALL = 0.085, 0.05, -0.35  # RMS slope of an octave of waves of 5 cm, and how it changes
VARIANTS = 4


@lru_cache(maxsize=2 * VARIANTS)
def fractal_levels(seed: int, side: int, spacing: float, levels: int, waves: tuple[float, float]) -> np.ndarray:
    """Draw a tile of self-affine relief, as `tile_levels`, for a strength of 1."""
    rng = np.random.default_rng((seed, 22))
    down, across = scipy.fft.fftfreq(side, spacing), scipy.fft.rfftfreq(side, spacing)
    k = np.hypot(down[:, None], across[None, :])
    k[0, 0] = 1e-9
    wavelength = 1 / k
    short, long = waves
    band = np.clip(np.log(wavelength / (0.8 * short)) / np.log(1.5), 0, 1) * np.clip(
        np.log(1.25 * long / wavelength) / np.log(1.5), 0, 1
    )
    octave = SLOPE * (wavelength / SLOPE_AT) ** SLOPE_FALL * band
    # E[hx^2] = integral of octave^2 / ln 2 over ln k, spread over rings of area 2 pi k^2 d ln k
    power = 2 * octave**2 / np.log(2) / (2 * np.pi * k**2) / (2 * np.pi * k) ** 2
    white = scipy.fft.rfft2(rng.standard_normal((side, side)))
    field = scipy.fft.irfft2(white * np.sqrt(power) / spacing, s=(side, side))
    return tile_levels(field, spacing, levels)


@lru_cache(maxsize=VARIANTS)
def ripple_tile(seed: int) -> np.ndarray:
    """Draw a tile of wind ripples with crests along y.

    The crests follow the phase of a narrow-band wave, which has forks and ends, as real ripples have (cf.
    scene.landforms). The lee side, towards +x, is the steeper one.

    Returns:
        (TILE, TILE) heights of unit variance, TEXELS nodes a wavelength.
    """
    rng = np.random.default_rng((seed, 8))
    across, down = scipy.fft.fftfreq(TILE)[None, :] * TEXELS, scipy.fft.fftfreq(TILE)[:, None] * TEXELS
    band = np.exp(-0.5 * (((across - 1) / 0.16) ** 2 + (down / 0.24) ** 2))
    wave = scipy.fft.ifft2(band * (rng.standard_normal((TILE, TILE, 2)) @ (1, 1j)))
    phase = np.angle(wave)
    phase -= 0.4 * np.cos(phase)
    strength = np.abs(wave) / np.sqrt(np.mean(np.abs(wave) ** 2))
    field = (1.3 - 2 * np.abs(np.sin(phase / 2)) ** 0.8) * np.minimum(1, strength / 0.7)
    field -= field.mean()
    return field / field.std()
