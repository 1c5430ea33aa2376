"""Stereo pairs from image files."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from m3depth.stereo.pairs import in_colour
from marssim.base.command.input_file import check_file
from marssim.base.files.pfm import decode_pfm
from marssim.base.files.png import MAGIC, is_whole

BRIGHT = 99.9  # [%] of a 16-bit pair's pixels are at most what becomes white: hot pixels do not darken all others


def read_pair(left: Path, right: Path) -> tuple[np.ndarray, np.ndarray]:
    """Two images as uint8 RGB (H, W, 3) or grey (H, W), both alike; alpha is dropped.

    16-bit pairs are scaled by one factor for both eyes. Raises FileNotFoundError or ValueError that names the file that
    is missing, unreadable, or of another size or depth than its partner.
    """
    a, b = _read(left), _read(right)
    if a.shape[:2] != b.shape[:2]:
        raise ValueError(
            f"{left} is {a.shape[1]} x {a.shape[0]}, {right} is {b.shape[1]} x {b.shape[0]}: "
            "a rectified pair has one size"
        )
    if a.dtype != b.dtype:
        raise ValueError(f"{left} is {a.dtype}, {right} is {b.dtype}: a pair must be of one depth, 8 or 16 bit")
    if a.dtype == np.uint16:
        white = max(1.0, *(float(np.percentile(image, BRIGHT)) for image in (a, b)))
        a, b = (np.round(np.minimum(image * (255 / white), 255)).astype(np.uint8) for image in (a, b))
    if a.ndim != b.ndim:
        a, b = in_colour(a), in_colour(b)
    return np.ascontiguousarray(a), np.ascontiguousarray(b)


def decoded(data: bytes, how: int = cv2.IMREAD_UNCHANGED) -> np.ndarray | None:
    """An image file as OpenCV reads it, (H, W) or BGR (H, W, 3), of any type; None, without a word, if it cannot be.

    how: OpenCV's flag, as IMREAD_GRAYSCALE.
    """
    if data.startswith(MAGIC) and not is_whole(data):  # libpng would say so on stderr
        return None
    if data[:2] in (b"Pf", b"PF"):
        values = decode_pfm(data)
        return values[..., ::-1] if values is not None and values.ndim == 3 else values
    log = cv2.utils.logging
    before = log.setLogLevel(log.LOG_LEVEL_SILENT)  # a broken file is told in our words
    try:
        return cv2.imdecode(np.frombuffer(data, np.uint8), how)
    except cv2.error:  # an empty file
        return None
    finally:
        log.setLogLevel(before)


def _read(path: Path) -> np.ndarray:
    """(H, W) or RGB (H, W, 3), uint8 or uint16."""
    check_file(path)
    image = decoded(path.read_bytes())
    if image is None:
        raise ValueError(f"{path}: not a readable image")
    if image.dtype not in (np.uint8, np.uint16):
        raise ValueError(f"{path}: holds {image.dtype}, must be 8 or 16 bit")
    if image.ndim == 3:
        image = image[..., 0] if image.shape[2] < 3 else image[..., 2::-1]  # BGR becomes RGB
    return image
