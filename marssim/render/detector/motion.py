"""Motion blur: the camera turns evenly while the shutter is open."""

from __future__ import annotations

import math

import cv2
import numpy as np

STEPS = 16  # samples along each pixel of the path


def moved(radiance: np.ndarray, length: float, direction_deg: float) -> np.ndarray:
    """Return the mean of the images along a short, straight path. The path's middle is the unblurred image.

    A turn by one or two degrees moves all of an image by nearly the same number of pixels, so one path is enough.

    Args:
        radiance: (H, W, 3) float32.
        length: Length of the path [px].
        direction_deg: Its direction in the image [deg], clockwise from the rows.

    Returns:
        (H, W, 3) float32.
    """
    return cv2.filter2D(radiance, -1, path(length, direction_deg), borderType=cv2.BORDER_REPLICATE)


def path(length: float, direction_deg: float) -> np.ndarray:
    """Return the path as weights (n, n) float32, n odd, whose sum is 1."""
    reach = math.ceil(length / 2)
    n = 2 * reach + 1
    along = np.linspace(-0.5, 0.5, STEPS * (reach + 1)) * length
    angle = math.radians(direction_deg)
    x, y = reach + along * math.cos(angle), reach + along * math.sin(angle)
    left, top = x.astype(int), y.astype(int)
    weights = np.zeros((n + 1, n + 1))  # the last row and column stay empty
    for down in (0, 1):
        for right in (0, 1):
            share = np.abs(1 - right - (x - left)) * np.abs(1 - down - (y - top))
            np.add.at(weights, (top + down, left + right), share)
    return (weights[:n, :n] / weights.sum()).astype(np.float32)
