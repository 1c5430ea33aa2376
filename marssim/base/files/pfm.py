"""Portable float maps, the files in which stereo benchmarks keep disparity."""

from __future__ import annotations

import re

import numpy as np

_HEADER = re.compile(rb"(P[fF])\s+(\d+)\s+(\d+)\s+([-+.\deE]+)(?:\r\n|\s)")


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


def decode_pfm(data: bytes) -> np.ndarray | None:
    """A PFM as (H, W) or RGB (H, W, 3) float32, rows from the top down; None if it is none, or broken.

    Of the header's scale the sign tells the byte order; how large it is, is ignored, as Middlebury's rules for its
    disparities ask. OpenCV divides by it.
    """
    header = _HEADER.match(data)
    if header is None:
        return None
    channels = 3 if header[1] == b"PF" else 1
    width, height = int(header[2]), int(header[3])
    try:
        order = "<" if float(header[4]) < 0 else ">"
    except ValueError:
        return None
    if not 0 < width * height * channels * 4 == len(data) - header.end():
        return None
    rows = np.frombuffer(data, f"{order}f4", offset=header.end()).reshape(height, width, channels)
    image = np.ascontiguousarray(np.flipud(rows), np.float32)
    return image if channels == 3 else image[..., 0]
