"""The ground between the rocks: pebbles and grain too small for the mesh, and the wind's small ripples.

Both are periodic tiles that lie on the ground by world position. Pebbles are modelled once as a height field; their
shadows are cast for the sun of the scene.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import scipy.fft

from marssim.base.compute.compiled import compiled, inlined
from marssim.render.surfaces.grain import STEP, TEXELS, TILE
from marssim.render.surfaces.pyramid import CODES, pyramid, pyramid_at

SIDE = 1024  # texels along a side of the tile of pebbles
TEXEL = 0.0028  # [m] size of a texel
SIZES = (0.006, 0.034)  # [m] least and largest diameter of pebbles; larger ones are rocks of the mesh
COVER = 0.12  # share of the tile that pebbles cover
STEEPEST = 1.5  # slope of the largest code
TONES = 1.5  # logarithm of brightness of the largest code
GRAIN = 3.5  # standard deviations of the grain of the largest code
GRAIN_BAND = (0.006, 0.2)  # [m] shortest and longest wavelength of the grain
PEBBLE_TONES = 0.3  # standard deviation of the logarithm of pebbles' brightness
LOWEST_SUN = 0.05  # tangent of the sun's elevation below which shadows of pebbles grow no longer
ROUGH = 0.3  # [texels] standard deviation of the grain's height
LONGEST = 40  # [texels] longest shadow of a pebble
WIDEST = 0.03  # [m] width of a pixel from which on it shows the tile's mean only
# A pebble. x, y, diameter: [texels]; turn: [rad]; narrow: short over long axis; blunt: sharpness of its shoulders;
# ratio: height over diameter; tilt_x, tilt_y: slopes of its top; tone: of unit variance.
PEBBLE_FIELDS = ("x", "y", "diameter", "turn", "narrow", "blunt", "ratio", "tilt_x", "tilt_y", "tone")
PEBBLE = np.dtype([(name, np.float64) for name in PEBBLE_FIELDS])
VARIANTS = 4  # number of tiles that scenes choose from; each scene turns and shifts its tile


@lru_cache(maxsize=VARIANTS)
def gravel(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Draw a periodic tile of pebbles. The number of pebbles larger than D falls as D^-3.

    Returns:
        Three maps, (SIDE, SIDE) float32 each: heights of pebbles [texels]; tones of unit variance, 0 between pebbles;
        and grain, noise of unit variance with equal power in each octave of wavelengths from 6 to 200 mm.
    """
    rng = np.random.default_rng((seed, 7))
    low, high = SIZES
    # mean of D^2 if the number of pebbles larger than D falls as D^-3
    square = 3 * low**2 * (1 - low / high) / (1 - (low / high) ** 3)
    count = int(COVER * (SIDE * TEXEL) ** 2 / (math.pi / 4 * square))
    diameter = rng.uniform(high**-3, low**-3, count) ** (-1 / 3)
    pebbles = np.empty(count, dtype=PEBBLE)
    pebbles["x"], pebbles["y"] = rng.uniform(0, SIDE, (2, count))
    pebbles["diameter"] = np.sort(diameter) / TEXEL
    pebbles["turn"] = rng.uniform(0, 2 * np.pi, count)
    pebbles["narrow"], pebbles["blunt"] = rng.uniform(0.6, 1.0, count), rng.uniform(2.0, 5.0, count)
    pebbles["ratio"] = rng.uniform(0.3, 0.6, count)
    pebbles["tilt_x"], pebbles["tilt_y"] = rng.normal(0, 0.35, (2, count))
    pebbles["tone"] = rng.standard_normal(count)
    heights, tones = _pebbles(pebbles, SIDE)
    k = np.hypot(scipy.fft.fftfreq(SIDE, TEXEL)[:, None], scipy.fft.rfftfreq(SIDE, TEXEL)[None, :])
    short, long = GRAIN_BAND
    band = np.exp(-((np.maximum(k * short, 1) - 1) ** 2)) * (1 - np.exp(-((k * long) ** 4))) / np.maximum(k, 1e-9)
    white = scipy.fft.rfft2(rng.standard_normal((SIDE, SIDE), dtype=np.float32))
    grain = scipy.fft.irfft2(white * band.astype(np.float32), s=(SIDE, SIDE))
    return heights, tones, (grain / grain.std()).astype(np.float32)


@compiled
def _pebbles(pebbles, side):
    """Return heights [texels] and tones of pebbles (N,) of PEBBLE: lumps with flat, tilted tops; the highest counts."""
    heights = np.zeros((side, side), dtype=np.float32)
    tones = np.zeros((side, side), dtype=np.float32)
    for n in range(len(pebbles)):
        pebble = pebbles[n]
        x, y, d, narrow = pebble.x, pebble.y, pebble.diameter, pebble.narrow
        cosine, sine, reach = math.cos(pebble.turn), math.sin(pebble.turn), int(0.5 * d / math.sqrt(narrow)) + 1
        for j in range(int(y) - reach, int(y) + reach + 2):
            for i in range(int(x) - reach, int(x) + reach + 2):
                u = (cosine * (i - x) + sine * (j - y)) / (0.5 * d) * math.sqrt(narrow)
                v = (cosine * (j - y) - sine * (i - x)) / (0.5 * d) / math.sqrt(narrow)
                r = math.sqrt(u * u + v * v)
                if r >= 1:
                    continue
                height = pebble.ratio * d * math.sqrt(1 - r**pebble.blunt)
                height *= 1 + pebble.tilt_x * u + pebble.tilt_y * v
                if height > heights[j % side, i % side]:
                    heights[j % side, i % side] = height
                    tones[j % side, i % side] = pebble.tone
    return heights, tones


@compiled
def _layers(heights, tones, grain, along, across, rise, pebble_tone, out):
    """Fill in the finest level, out (SIDE, SIDE, 5), in codes; heights [texels]; see grit.

    along, across: unit vector towards the sun in the tile; rise: tangent of the sun's elevation.
    """
    side = len(heights)
    top = heights.max()
    slope, tone = np.float32(CODES / STEEPEST / 2), np.float32(CODES / TONES)
    most, rough = np.float32(CODES), np.float32(ROUGH)
    for j in range(side):
        above, below = (j - 1) % side, (j + 1) % side
        for i in range(side):
            left, right = (i - 1) % side, (i + 1) % side
            start = heights[j, i]
            du = heights[j, right] - heights[j, left] + rough * (grain[j, right] - grain[j, left])
            dv = heights[below, i] - heights[above, i] + rough * (grain[below, i] - grain[above, i])
            shade = np.float32(0)
            for n in range(1, min(int((top - start) / rise), LONGEST) + 1):
                if heights[int(j + n * across + 0.5) % side, int(i + n * along + 0.5) % side] > start + n * rise:
                    shade = most
                    break
            out[j, i, 0] = min(max(slope * du, -most), most)
            out[j, i, 1] = min(max(slope * dv, -most), most)
            bright = pebble_tone + np.float32(PEBBLE_TONES) * tones[j, i] if start > 0 else np.float32(0)
            out[j, i, 2] = min(max(tone * bright, -most), most)
            out[j, i, 3] = shade
            out[j, i, 4] = min(max(grain[j, i] * np.float32(CODES / GRAIN), -most), most)


def grit(seed: int, turn: float, sun: np.ndarray, pebble_tone: float) -> np.ndarray:
    """Return the tile of pebbles and grain at all resolutions.

    Args:
        seed: Seed that chooses one of VARIANTS tiles.
        turn: Angle from the world's axes to the tile's [rad].
        sun: (3,) unit vector towards the sun, world frame.
        pebble_tone: Mean tone of the pebbles, as logarithm of brightness.

    Returns:
        (M, 5) int8 of `pyramid`: slopes along and across in STEEPEST / CODES, tone (logarithm of brightness) in
        TONES / CODES, shade (share of the sun that pebbles hide) in 1 / CODES, and grain in GRAIN / CODES standard
        deviations.
    """
    heights, tones, grain = gravel(seed % VARIANTS)
    cosine, sine = math.cos(turn), math.sin(turn)
    level = math.hypot(sun[0], sun[1])
    along, across = cosine * sun[0] - sine * sun[1], sine * sun[0] + cosine * sun[1]
    rise = float(sun[2]) / max(level, 1e-6)
    finest = np.empty((SIDE, SIDE, 5), dtype=np.float32)
    _layers(
        heights, tones, grain, along / max(level, 1e-6), across / max(level, 1e-6), max(rise, LOWEST_SUN),
        np.float32(pebble_tone), finest,
    )  # fmt: skip
    return pyramid(finest)


@lru_cache(maxsize=VARIANTS)
def ripple_tile(seed: int) -> np.ndarray:
    """Draw a tile of wind ripples with crests along y, and their slopes.

    The crests follow the phase of a narrow-band wave, which has forks and ends, as real ripples have (cf.
    scene.landforms). The lee side, towards +x, is the steeper one.

    Returns:
        (TILE + 1, TILE + 1, 3) int16, coded as `grain.coded_tile`.
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
    slopes = (np.roll(field, -1, axis) - np.roll(field, 1, axis) for axis in (1, 0))
    out = np.stack([field, *slopes], axis=-1)
    out[..., 0] /= out[..., 0].std()
    out[..., 1:] /= np.sqrt(np.mean(out[..., 1:] ** 2) * 2)
    out = np.pad(out, ((0, 1), (0, 1), (0, 0)), mode="wrap")
    return np.clip(np.rint(out / STEP), -32768, 32767).astype(np.int16)


@inlined
def grit_at(placed, u, v, footprint):
    """Return slopes along u and v, tone, shade and grain of the pebbles at surface coordinates u, v [m].

    placed: PlacedTile of `grit`; footprint: width of a pixel on the ground [m].
    """
    along, across, tone, shade, grain = pyramid_at(placed, SIDE, TEXEL, u, v, footprint)
    steep = np.float32(STEEPEST / CODES)
    return (
        steep * along, steep * across, tone * np.float32(TONES / CODES), shade * np.float32(1 / CODES),
        grain * np.float32(GRAIN / CODES),
    )  # fmt: skip
