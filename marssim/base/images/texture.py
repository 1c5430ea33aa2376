"""Measure the texture of an image: its gradient, and the entropy of local binary patterns (Ojala et al. 2002)."""

from __future__ import annotations

import cv2
import numpy as np

NEIGHBOURS = 8  # neighbours of a pixel in a pattern


def gradient(grey: np.ndarray) -> np.ndarray:
    """Return the length of the image gradient, by Sobel's 3 x 3 operator over 8.

    Args:
        grey: (H, W) image.

    Returns:
        (H, W) [grey levels / px].
    """
    across, down = (cv2.Sobel(grey, cv2.CV_32F, *order, ksize=3, scale=1 / 8) for order in ((1, 0), (0, 1)))
    return np.hypot(across, down)


def local_binary_patterns(grey: np.ndarray) -> np.ndarray:
    """Return the local binary pattern of each pixel: bit p is set if neighbour p is at least as bright as the pixel.

    Neighbour p lies on a circle of radius 1 px, at p / 8 of a turn counter-clockwise from the right. Diagonal
    neighbours are interpolated bilinearly.

    Args:
        grey: (H, W) uint8, at least 3 x 3.

    Returns:
        (H - 2, W - 2) uint8 codes of the pixels inside the border.
    """
    image = grey.astype(np.float64)
    height, width = image.shape
    middle = image[1:-1, 1:-1]
    codes = np.zeros(middle.shape, np.uint8)
    for p in range(NEIGHBOURS):
        angle = 2 * np.pi * p / NEIGHBOURS
        y, x = np.round(-np.sin(angle), 9), np.round(np.cos(angle), 9)
        low_y, low_x = int(np.floor(y)), int(np.floor(x))
        value = np.zeros_like(middle)
        for dy, dx in ((0, 0), (0, 1), (1, 0), (1, 1)):
            share = (y - low_y if dy else 1 - (y - low_y)) * (x - low_x if dx else 1 - (x - low_x))
            if share > 0:
                top, left = 1 + low_y + dy, 1 + low_x + dx
                value += share * image[top : top + height - 2, left : left + width - 2]
        codes |= (value >= middle - 1e-9).astype(np.uint8) << np.uint8(p)
    return codes


def uniform_labels() -> np.ndarray:
    """Return the (256,) label of each code: the number of its set bits if it is uniform, else 9.

    A code is uniform if at most two of its bits differ from the next one around the circle.
    """
    bits = (np.arange(256)[:, None] >> np.arange(NEIGHBOURS)) & 1
    changes = (bits != np.roll(bits, 1, axis=1)).sum(axis=1)
    return np.where(changes <= 2, bits.sum(axis=1), NEIGHBOURS + 1)


def entropy(labels: np.ndarray) -> float:
    """Return the Shannon entropy of the histogram of integer labels [bits]."""
    share = np.bincount(labels.ravel()) / labels.size
    share = share[share > 0]
    return float(-(share * np.log2(share)).sum())


def lbp_entropy(grey: np.ndarray, where: np.ndarray) -> float:
    """Return the entropy of uniform, rotation-invariant local binary patterns of 8 points and radius 1 px (LBP riu2).

    Args:
        grey: (H, W) uint8.
        where: (H, W) bool, the pixels that count. Pixels of the border have no pattern.

    Returns:
        The entropy [bits]; 0 if no pixel counts.
    """
    inner = where[1:-1, 1:-1]
    return entropy(uniform_labels()[local_binary_patterns(grey)[inner]]) if inner.any() else 0.0
