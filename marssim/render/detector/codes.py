"""Noise and 8-bit codes of a detector, and the contrast stretch of public images."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from marssim.base.compute.compiled import compiled

GAMMA = 2.2  # the 8-bit code of a signal is proportional to its share of full scale to the power 1 / GAMMA
GUESSES = 32768  # entries of the table of guesses: above the darkest codes, a guess is right or one too low
WHOLE = (0.0, 255.0)


class Readout(NamedTuple):
    """What the codes of an image are computed from.

    Attributes:
        signal: (H, W, 3) float32 linear RGB.
        noise: (H, W, 3) float32 standard normal draws.
        gain: Factor from the signal to full scale.
        vignetting: Share of the light that is lost in the corners.
        full_well: Number of electrons at full scale.
        read_noise: Standard deviation of the read noise [electrons].
    """

    signal: np.ndarray
    noise: np.ndarray
    gain: float
    vignetting: float
    full_well: float
    read_noise: float

    def codes(self, limits: tuple[float, float] = WHOLE) -> np.ndarray:
        """Return the 8-bit image.

        Args:
            limits: Codes that become black and white; those between are stretched evenly. The signal is stretched
                before it is rounded, as 12-bit images are, so that no code is skipped.

        Returns:
            (H, W, 3) uint8.
        """
        return _codes(*self, *_tables(limits))


def stretch_limits(image: np.ndarray, share: float) -> tuple[float, float]:
    """Return the codes beyond which a share of an image's values lies at either end.

    Args:
        image: uint8, of any shape.
        share: Share of the values that become black, and share that become white.

    Returns:
        The lower and the upper limit, at least one code apart.
    """
    below = np.cumsum(np.bincount(image.ravel(), minlength=256)) / image.size
    low = int(np.searchsorted(below, share))
    high = int(np.searchsorted(below, 1 - share))
    return float(min(low, 254)), float(max(high, min(low, 254) + 1))


@lru_cache(maxsize=4)
def _tables(limits: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Return the least signal of each code from 1, as a share of full scale, and a first guess of signals' codes.

    No signal reaches the last entry of the first table.
    """
    low, high = limits[0] / 255, limits[1] / 255
    starts = low + (high - low) * (np.arange(1, 256) - 0.5) / 255
    starts = np.append(starts**GAMMA, np.inf).astype(np.float32)
    return starts, np.searchsorted(starts, np.arange(GUESSES + 1) / GUESSES, side="right").astype(np.uint8)


@compiled
def _codes(signal, noise, gain, vignetting, full_well, read_noise, starts, guess):
    """Apply vignetting, noise and gamma. The code is looked up, with the same result as rounding the power."""
    height, width, _ = signal.shape
    out = np.empty(signal.shape, dtype=np.uint8)
    shot = np.float32(1 / full_well)  # variance of the noise per signal, both as shares of full scale
    floor = np.float32((read_noise / full_well) ** 2)
    black, white, guesses = np.float32(0), np.float32(1), np.float32(GUESSES)
    for row in range(height):
        y = 2 * row / max(height - 1, 1) - 1
        for column in range(width):
            x = 2 * column / max(width - 1, 1) - 1
            scale = np.float32(gain * (1 - vignetting * (x * x + y * y) / 2))
            for c in range(3):
                value = min(max(signal[row, column, c] * scale, black), white)
                value += noise[row, column, c] * math.sqrt(value * shot + floor)
                value = min(max(value, black), white)
                code = guess[np.int32(value * guesses)]
                while value >= starts[code]:
                    code += 1
                out[row, column, c] = code
    return out
