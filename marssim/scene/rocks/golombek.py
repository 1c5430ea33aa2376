"""The size-frequency law of rocks by Golombek and Rapp (1997).

Rocks of diameter D and more cover the share F_k(D) = k exp(-q D) of the ground, with q = 1.79 + 0.152 / k. The number
of such rocks is N(>D) = (4 k q / pi) [exp(-q D) / D - q E1(q D)] per square metre. D is the diameter of the disc with
the area of the rock's outline above ground, seen from above: that is what is counted from orbit.
"""

from __future__ import annotations

import numpy as np
from scipy.special import exp1

MAX_DIAMETER = 2.5  # [m] diameter of the largest rocks
REPORTED = (0.1, 0.15, 0.2, 0.3, 0.4, 0.5)  # [m] diameters at which a scene reports F_k(D)


def decay(k: float) -> float:
    """Return q(k) of the law [1/m]."""
    return 1.79 + 0.152 / k


def covered_area(diameter: np.ndarray, k: float) -> np.ndarray:
    """Return F_k(D), the share of the ground that rocks of diameter D [m] and more cover."""
    return k * np.exp(-decay(k) * np.asarray(diameter)) if k > 0 else np.zeros_like(diameter, dtype=float)


def number_density(diameter: np.ndarray, k: float) -> np.ndarray:
    """Return N(>D), the number of rocks of diameter D [m] and more per square metre."""
    d = np.asarray(diameter, dtype=float)
    if k == 0:
        return np.zeros_like(d)
    q = decay(k)
    return 4 * k * q / np.pi * (np.exp(-q * d) / d - q * exp1(q * d))


def sampling_spread(diameter: np.ndarray, k: float, area: float) -> np.ndarray:
    """Return the standard deviation of the share of an area that rocks from D to MAX_DIAMETER cover by chance.

    Rocks fall independently (a Poisson process), so the variance is the integral of the squared outline over the size
    distribution: var = (pi k q / 4 A) int_D x^2 exp(-q x) dx.

    Args:
        diameter: (...) least diameters D [m].
        k: Rock abundance.
        area: Area A [m2].

    Returns:
        (...) standard deviations.
    """
    d = np.asarray(diameter, dtype=float)
    if k == 0:
        return np.zeros_like(d)
    q = decay(k)

    def tail(x: np.ndarray) -> np.ndarray:
        return np.exp(-q * x) * (x * x / q + 2 * x / q**2 + 2 / q**3)

    return np.sqrt(np.pi * k * q / (4 * area) * np.maximum(tail(d) - tail(np.array(MAX_DIAMETER)), 0))


def draw_diameters(k: float, smallest: float, area: float, rng: np.random.Generator) -> np.ndarray:
    """Draw the rocks of an area by a Poisson process.

    Args:
        k: Rock abundance.
        smallest: Least diameter [m].
        area: Area [m2].
        rng: Random generator.

    Returns:
        (N,) diameters [m] from `smallest` to MAX_DIAMETER, descending.
    """
    if k == 0 or area <= 0:
        return np.zeros(0)
    grid = np.geomspace(smallest, MAX_DIAMETER, 400)
    number = number_density(grid, k) - number_density(np.array(MAX_DIAMETER), k)
    count = rng.poisson(number[0] * area)
    level = rng.uniform(0, number[0], count)
    return np.sort(np.interp(level, number[::-1], grid[::-1]))[::-1]
