"""Bilinear interpolation on a tile or map: the weights of the four texels around a point."""

from __future__ import annotations

import numpy as np

from marssim.base.compute.compiled import inlined


@inlined
def bilinear_weights(s, t):
    """Return the float32 weights of the texels at (0, 0), (1, 0), (0, 1), (1, 1) for a point s, t in [0, 1]."""
    both = s * t
    return np.float32(1) - s - (t - both), s - both, t - both, both
