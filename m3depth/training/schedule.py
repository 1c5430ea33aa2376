"""The schedule of the learning rate."""

from __future__ import annotations

import math

WARM_UP = 0.04  # share of the run in which the learning rate rises


def learning_rate(peak: float, progress: float) -> float:
    """Return the learning rate of one cycle: a linear rise, then a cosine down to a hundredth.

    Args:
        peak: Highest rate.
        progress: Share of the run that is done.
    """
    if progress < WARM_UP:
        return peak * (0.05 + 0.95 * progress / WARM_UP)
    fall = min(1.0, (progress - WARM_UP) / (1 - WARM_UP))
    return peak * (0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * fall)))
