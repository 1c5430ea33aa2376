"""Pixels between two surfaces, whose measured depth belongs to neither."""

from __future__ import annotations

import cv2
import numpy as np

JUMP = 1.0  # [px]


def depth_edges(disparity: np.ndarray, jump: float = JUMP, share: float = 0.0) -> np.ndarray:
    """(H, W) bool: within 3 x 3 px the disparity changes by more than `jump` [px] and more than `share` of itself.

    disparity: (H, W) [px]; what is not finite counts as 0. Level ground changes by baseline / camera height per row,
    0.22 px for NaTeCam, at any distance and resolution: one threshold serves all. A steep surface near by changes
    faster, which a share allows for.
    """
    known = np.where(np.isfinite(disparity), disparity, 0).astype(np.float32, copy=False)
    kernel = np.ones((3, 3), np.uint8)
    high, low = cv2.dilate(known, kernel), cv2.erode(known, kernel)
    return high - low > (np.maximum(jump, share * high) if share else jump)
