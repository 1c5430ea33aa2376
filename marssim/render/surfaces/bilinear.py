"""Bilinear interpolation on a tile or map: what the four texels about a place count."""

from __future__ import annotations

import numpy as np

from marssim.base.compute.compiled import inlined


@inlined
def bilinear_weights(s, t):
    """Of the texels at (0, 0), (1, 0), (0, 1) and (1, 1), for a place s, t in [0, 1] between them. float32."""
    both = s * t
    return np.float32(1) - s - (t - both), s - both, t - both, both
