"""The Euclidean distance transform of a grid, with the same bits on every build of OpenCV and every machine.

OpenCV calls IPP if it was built with it and has one thread, as in worker processes; with more threads it computes the
transform itself. IPP's roots are wrong in their last bits, and not always the same way. Squares of distances on a grid
are whole numbers, so squaring, rounding and taking the root gives the same distance from both.
"""

from __future__ import annotations

import cv2
import numpy as np


def euclidean_distance(free: np.ndarray) -> np.ndarray:
    """Return the distance of each free cell to the nearest cell that is not free, from centre to centre.

    Args:
        free: (h, w) bool or uint8.

    Returns:
        (h, w) float32 [cells]; 0 where a cell is not free. It is exact up to 500 cells, but for the rounding of
        float32, and within a millionth of itself beyond.

    Raises:
        ValueError: Every cell is free.
    """
    free = np.asarray(free, np.uint8)
    if free.all():
        raise ValueError("every cell is free, so there is no nearest cell that is not")
    distance = cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(np.sqrt(np.rint(np.square(distance))))
