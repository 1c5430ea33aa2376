"""Portable float maps, the files in which stereo benchmarks keep disparity."""

from __future__ import annotations

import numpy as np


def encode_pfm(image: np.ndarray) -> bytes:
    """A grey PFM: header `Pf`, width and height, -1 (little-endian, scale 1); float32 rows from the bottom up.

    image: (H, W). Raises ValueError for another shape and for NaN, which readers take for a broken file.
    """
    if image.ndim != 2:
        raise ValueError(f"a grey PFM holds an image (H, W), this is {image.shape}")
    if np.isnan(image).any():
        raise ValueError("a PFM of disparities must not hold NaN")
    height, width = image.shape
    return f"Pf\n{width} {height}\n-1\n".encode() + np.flipud(image).astype("<f4").tobytes()
