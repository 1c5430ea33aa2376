"""How much texture an image has about each pixel: its gradient, and local binary patterns (Ojala et al. 2002)."""

from __future__ import annotations

import cv2
import numpy as np

NEIGHBOURS = 8


def gradient(grey: np.ndarray) -> np.ndarray:
    """(H, W) length of the image gradient [grey levels / px], by Sobel's 3 x 3 operator over 8."""
    across, down = (cv2.Sobel(grey, cv2.CV_32F, *order, ksize=3, scale=1 / 8) for order in ((1, 0), (0, 1)))
    return np.hypot(across, down)


def local_binary_patterns(grey: np.ndarray) -> np.ndarray:
    """(H - 2, W - 2) uint8 codes: bit p is set where the neighbour at angle p / 8 is at least as bright.

    grey: (H, W) uint8, at least 3 x 3. Neighbours lie on a circle of radius 1 px, counter-clockwise from the right;
    diagonal ones are bilinear.
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
    """(256,) label of each code: the number of set bits where at most two neighbours differ around it, else 9."""
    bits = (np.arange(256)[:, None] >> np.arange(NEIGHBOURS)) & 1
    changes = (bits != np.roll(bits, 1, axis=1)).sum(axis=1)
    return np.where(changes <= 2, bits.sum(axis=1), NEIGHBOURS + 1)


def entropy(labels: np.ndarray) -> float:
    """Bits of the histogram of integer labels."""
    share = np.bincount(labels.ravel()) / labels.size
    share = share[share > 0]
    return float(-(share * np.log2(share)).sum())


def lbp_entropy(grey: np.ndarray, where: np.ndarray) -> float:
    """Entropy [bits] of uniform rotation-invariant local binary patterns, 8 points, radius 1 px (LBP 8,1 riu2).

    grey: (H, W) uint8; where: (H, W) bool, pixels to count; those of the border have no pattern. 0 where none is left.
    """
    inner = where[1:-1, 1:-1]
    return entropy(uniform_labels()[local_binary_patterns(grey)[inner]]) if inner.any() else 0.0
