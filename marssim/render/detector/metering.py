"""Auto-exposure: how much light the detector collects of a scene."""

from __future__ import annotations

import numpy as np

from marssim.base.compute.compiled import compiled
from marssim.render.detector.codes import GAMMA

LEAST_METERED_SHARE = 0.05  # least share of the image at which ground or sky is metered separately


def metered_gain(radiance: np.ndarray, ground: np.ndarray, exposure: float) -> float:
    """Return the factor from radiance to full scale.

    Args:
        radiance: (H, W, 3) linear RGB radiance.
        ground: (H, W) bool, the pixels that are not sky.
        exposure: 8-bit code of the ground's median brightness as a share of 255. It is less where otherwise the
            ground's brightest 2 % would exceed 90 % of full scale, or half of the sky would saturate.
    """
    pixels, share = radiance.reshape(-1, 3), ground.mean()
    metered = ground.ravel() if share > LEAST_METERED_SHARE else np.ones(ground.size, bool)
    light, strongest = _metered(pixels, metered)
    high = min(int(0.98 * len(light)), len(light) - 1)
    middle, bright = float(np.median(light)), float(np.partition(strongest, high)[high])
    # `exposure` is a code, so its linear value is a power; the ground's highlights and most of the sky are kept
    gain = min(exposure**GAMMA / max(middle, 1e-6), 0.9 / max(bright, 1e-6))
    if share < 1 - LEAST_METERED_SHARE:
        _, sky = _metered(pixels, ~ground.ravel())
        gain = min(gain, 1 / max(float(np.median(sky)), 1e-6))
    return gain


@compiled
def _metered(radiance, chosen):
    """Return the mean and the largest channel (M,) of the chosen (N,) pixels of radiance (N, 3)."""
    count = chosen.sum()
    mean, largest = np.empty(count, dtype=np.float32), np.empty(count, dtype=np.float32)
    m = 0
    for k in range(len(radiance)):
        if chosen[k]:
            red, green, blue = radiance[k, 0], radiance[k, 1], radiance[k, 2]
            mean[m] = (red + green + blue) / np.float32(3)
            largest[m] = max(red, green, blue)
            m += 1
    return mean, largest
