"""The Euclidean distance transform of a grid, to the last bit whatever OpenCV was built with or runs on.

OpenCV leaves it to IPP where it has one thread and IPP, as in workers, and computes it itself where it has more. IPP's
roots are off in their last bits, and which way need not be the same each time. The squares of distances on a grid are
whole numbers, so both are mended alike: the root of the nearest one is the distance.
"""

from __future__ import annotations

import cv2
import numpy as np


def euclidean_distance(free: np.ndarray) -> np.ndarray:
    """Distance of each cell's centre to that of the nearest cell that is not free [cells].

    free: (h, w) bool or uint8, at least one cell of which is not free. Returns (h, w) float32, 0 where not free, exact
    but for float32's own rounding up to 500 cells, within a millionth of itself beyond. Raises ValueError where every
    cell is free.
    """
    free = np.asarray(free, np.uint8)
    if free.all():
        raise ValueError("every cell is free: there is nothing to measure a distance to")
    distance = cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(np.sqrt(np.rint(np.square(distance))))
