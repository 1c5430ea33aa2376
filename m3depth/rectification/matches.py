"""Points that both images of a pair show, by SIFT (Lowe 2004), in a band of rows."""

from __future__ import annotations

import cv2
import numpy as np

MOST_POINTS = 8000
LEAST_CONTRAST = 0.02  # of a point, half of OpenCV's default: the ground of Mars is smooth
RATIO = 0.8  # of the distances to the best and the second best description (Lowe's test)
LARGEST = 12.0  # [px] diameter of a point; the places of larger ones are less exact
BORDER = 9  # [px] around what shows nothing where no points are taken
CHUNK = 500


def matched_points(
    left: np.ndarray, right: np.ndarray, valid: tuple[np.ndarray, np.ndarray], reach: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return points of the left image, and where the right one shows them.

    Args:
        left: (H, W) uint8.
        right: (H', W') uint8.
        valid: Where each image shows something, bool.
        reach: How far the rows of a point may lie apart [px].

    Returns:
        (N, 2) and (N, 2) column and row [px]. Some are wrong.
    """
    (a, described_a), (b, described_b) = (_points(*eye) for eye in zip((left, right), valid))
    if len(a) < 2 or len(b) < 2:
        return np.zeros((0, 2)), np.zeros((0, 2))
    first, certain = _nearest(a, described_a, b, described_b, reach)
    back, _ = _nearest(b, described_b, a, described_a, reach)
    mutual = certain & (back[first] == np.arange(len(a)))
    return a[mutual], b[first[mutual]]


def _points(image: np.ndarray, valid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return places (N, 2) and descriptions (N, 128) of unit length."""
    mask = cv2.erode(
        valid.astype(np.uint8), np.ones((BORDER, BORDER), np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=0
    )
    sift = cv2.SIFT.create(nfeatures=MOST_POINTS, contrastThreshold=LEAST_CONTRAST)
    points, described = sift.detectAndCompute(image, mask)
    keep = [i for i, point in enumerate(points) if point.size <= LARGEST]
    if described is None or not keep:
        return np.zeros((0, 2)), np.zeros((0, 128), np.float32)
    described = described[keep]
    described /= np.maximum(np.linalg.norm(described, axis=1, keepdims=True), 1e-12)
    return np.array([points[i].pt for i in keep]), described


def _nearest(
    a: np.ndarray, described_a: np.ndarray, b: np.ndarray, described_b: np.ndarray, reach: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the index of the most similar one of `b` in the band of each of `a`, and whether it passes Lowe's test."""
    order = np.argsort(b[:, 1])
    rows = b[order, 1]
    best, certain = np.zeros(len(a), int), np.zeros(len(a), bool)
    by_row = np.argsort(a[:, 1])
    for start in range(0, len(a), CHUNK):
        chunk = by_row[start : start + CHUNK]
        low = np.searchsorted(rows, a[chunk[0], 1] - reach)
        high = np.searchsorted(rows, a[chunk[-1], 1] + reach, side="right")
        if high - low < 2:
            continue
        near = order[low:high]
        likeness = described_a[chunk] @ described_b[near].T
        likeness[np.abs(a[chunk, 1][:, None] - b[near, 1]) > reach] = -1
        index, first = np.arange(len(chunk)), likeness.argmax(axis=1)
        most = likeness[index, first]
        likeness[index, first] = -np.inf
        distance, other = (np.sqrt(np.maximum(2 - 2 * like, 0)) for like in (most, likeness.max(axis=1)))
        best[chunk] = near[first]
        certain[chunk] = (distance < RATIO * other) & (most > 0)
    return best, certain
