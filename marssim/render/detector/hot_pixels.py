"""Hot pixels: single pixels that collect charge without light, more of them the longer a detector is in space.

In the sky of two Navcam images of Curiosity (sol 1431), the number of pixels above their surroundings falls by a factor
of e with each 20 to 25 codes, and some 1,000 in a million would be above 0. The mean strength follows from this.
"""

from __future__ import annotations

import numpy as np

STRENGTH = 0.05  # mean charge of a hot pixel as a share of full scale; its distribution is exponential


def with_hot_pixels(signal: np.ndarray, per_million: float, seed: int, eye: int) -> np.ndarray:
    """Return the signal with the charge of hot pixels.

    Args:
        signal: (H, W, 3) shares of full scale.
        per_million: Hot pixels in a million.
        seed: Seed of their places and strengths.
        eye: 0 for the left camera, 1 for the right one, which has hot pixels of its own.

    Returns:
        (H, W, 3) float32.
    """
    rng = np.random.default_rng((seed, 3 + eye))
    height, width = signal.shape[:2]
    places = rng.integers(height * width, size=rng.poisson(per_million * 1e-6 * height * width))
    out: np.ndarray = signal.astype(np.float32, copy=True)
    np.add.at(out.reshape(-1, 3), places, rng.exponential(STRENGTH, (len(places), 1)).astype(np.float32))
    return out
