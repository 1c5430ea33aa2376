"""Dust on the window of a camera.

A grain on the window is so close to the lens that its image is a disc, as large as the lens's aperture is seen from the
window. There it takes away a part of the light, and it adds light that it scatters from the whole scene: the image is
a I + s with smooth maps a and s (Gu, Ramamoorthi, Belhumeur and Nayar, "Removing image artifacts due to dirty camera
lenses and thin occluders", ACM Trans. Graph. 28, 2009). Grains too fine to be seen alone make a veil.
"""

from __future__ import annotations

import math
from functools import lru_cache

import cv2
import numpy as np

from marssim.base.compute.compiled import compiled

COARSE = 192  # [px] width at which the maps are computed, since all in them is wider than a few pixels
UNEVEN = 0.3  # standard deviation of the logarithm of the ratio between the two windows' dust
VEIL = 0.4  # share of the loss that is the veil's
CELLS = 4  # cells of the veil's unevenness along each side
DISC = (0.035, 0.07)  # radius of the discs, as a share of the image's width
DEEPEST, MEDIAN, SPREAD = 0.6, 0.05, 1.0  # light that a grain takes from its disc: most, median, and log-deviation
SOFTEST = 0.25  # least width of a rim, as a share of the radius
MOST_SPECKS = 400
SCATTER = (0.3, 1.1)  # light that dust adds, as a share of what it would add if it were as bright as the scene


def through_dust(radiance: np.ndarray, loss: float, seed: int, eye: int) -> np.ndarray:
    """Return the radiance behind a dusty window.

    Args:
        radiance: (H, W, 3) float32.
        loss: Share of the light that the dust of both windows takes away, in the mean, up to 0.3. With MOST_SPECKS, 0.4
            takes away 0.33, and 0.8 takes away 0.48.
        seed: Seed of the dust. The same seed gives the same specks.
        eye: 0 for the left camera, 1 for the right one, whose window has specks of its own.

    Returns:
        (H, W, 3) float32.
    """
    passed = transmission(loss, seed, eye, radiance.shape[:2])[..., None]
    scattered = np.float32(np.random.default_rng((seed, 2)).uniform(*SCATTER)) * radiance.mean(axis=(0, 1))
    return passed * (radiance - scattered) + scattered


@lru_cache(maxsize=4)  # a drive keeps its dust
def transmission(loss: float, seed: int, eye: int, size: tuple[int, int]) -> np.ndarray:
    """Return the share of the light that passes the window.

    Args:
        loss, seed, eye: See through_dust.
        size: Height and width of the image [px].

    Returns:
        (H, W) float32 in (0, 1], read-only.
    """
    rng = np.random.default_rng((seed, eye))
    loss = min(loss * float(np.exp(UNEVEN * rng.standard_normal())), 0.9)
    height, width = max(2, round(COARSE * size[0] / size[1])), COARSE
    passed = (1 - VEIL * loss * _unevenness(rng, (height, width))) * _specks(rng, (1 - VEIL) * loss, (height, width))
    out: np.ndarray = np.clip(cv2.resize(passed, size[::-1], interpolation=cv2.INTER_LINEAR), 0.02, 1)
    out.flags.writeable = False
    return out


def _unevenness(rng: np.random.Generator, size: tuple[int, int]) -> np.ndarray:
    """Return a smooth field (H, W) float32 around 1."""
    cells = np.exp(0.4 * rng.standard_normal((CELLS + 1, CELLS + 1), dtype=np.float32))
    return cv2.resize(cells, size[::-1], interpolation=cv2.INTER_LINEAR)


def _specks(rng: np.random.Generator, loss: float, size: tuple[int, int]) -> np.ndarray:
    """Return what the grains let pass (H, W) float32; in the mean they take away `loss`, or less at MOST_SPECKS."""
    height, width = size
    out = np.ones(size, dtype=np.float32)
    radius = rng.uniform(*DISC) * width
    taken, due = 0.0, loss * height * width
    for _ in range(MOST_SPECKS):
        if taken >= due:
            break
        x, y = rng.uniform(-radius, width + radius), rng.uniform(-radius, height + radius)
        depth = min(MEDIAN * float(np.exp(SPREAD * rng.standard_normal())), DEEPEST)
        taken += _add_speck(out, x, y, radius * rng.uniform(0.85, 1.15), depth)
    return out


@compiled
def _add_speck(out, x, y, radius, depth):
    """Darken a disc of `out` in place, whose rim is as soft as the grain is wide; return the light taken away [px]."""
    height, width = out.shape
    soft = max(math.sqrt(depth), SOFTEST) * radius  # a grain of radius g takes (g / radius)^2
    reach, lost = radius + soft, 0.0
    for v in range(max(0, int(y - reach)), min(height, int(y + reach) + 2)):
        for u in range(max(0, int(x - reach)), min(width, int(x + reach) + 2)):
            share = min(max((reach - math.hypot(u - x, v - y)) / (2 * soft), 0.0), 1.0)
            taken = depth * share * share * (3 - 2 * share)
            lost += out[v, u] * taken
            out[v, u] *= 1 - taken
    return lost
