"""Read and write PFM (portable float map) files, in which stereo benchmarks keep disparity."""

from __future__ import annotations

import re

import numpy as np

_HEADER = re.compile(rb"(P[fF])\s+(\d{1,9})\s+(\d{1,9})\s+([-+.\deE]+)(?:\r\n|\s)")


def encode_pfm(image: np.ndarray) -> bytes:
    """Encode a map as PFM: header `Pf` or `PF`, width and height, -1 (little-endian, scale 1); rows from the bottom up.

    Args:
        image: (H, W), or (H, W, 3) in RGB's order, stored as float32.

    Raises:
        ValueError: The map has another shape, or holds NaN, which readers take for a broken file.
    """
    if image.ndim != 2 and image.shape[2:] != (3,):
        raise ValueError(f"a PFM holds a map (H, W) or (H, W, 3), got the shape {image.shape}")
    if np.isnan(image).any():
        raise ValueError("a PFM must not hold NaN, since readers take it for a broken file")
    height, width = image.shape[:2]
    kind = "Pf" if image.ndim == 2 else "PF"
    return f"{kind}\n{width} {height}\n-1\n".encode() + np.flipud(image).astype("<f4").tobytes()


def decode_pfm(data: bytes) -> np.ndarray | None:
    """Decode a PFM.

    The sign of the header's scale gives the byte order. Its magnitude is ignored, as Middlebury's rules for disparities
    ask; OpenCV divides by it.

    Args:
        data: Content of the file.

    Returns:
        (H, W) or RGB (H, W, 3) float32, rows from the top down; None if the data is no PFM or is broken.
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
