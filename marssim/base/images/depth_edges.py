"""Find depth edges: pixels between two surfaces, whose measured depth may belong to neither."""

from __future__ import annotations

import cv2
import numpy as np

JUMP = 1.0  # [px] change of disparity above which there is an edge


def depth_edges(disparity: np.ndarray, jump: float = JUMP, share: float = 0.0) -> np.ndarray:
    """Return where disparity changes by more than `jump`, and by more than `share` of itself, within 3 x 3 px.

    On level ground disparity changes by baseline / camera height per row, 0.22 px for NaTeCam, at any distance and
    resolution. So one threshold serves all images of such cameras; one for others has to be larger if theirs changes
    faster. On a near, steep surface it changes faster, too, which `share` allows.

    Args:
        disparity: (H, W) [px]; values that are not finite count as 0.
        jump: Threshold [px].
        share: Threshold as a share of the largest disparity within the 3 x 3 px.

    Returns:
        (H, W) bool.
    """
    finite = np.where(np.isfinite(disparity), disparity, 0).astype(np.float32, copy=False)
    kernel = np.ones((3, 3), np.uint8)
    high, low = cv2.dilate(finite, kernel), cv2.erode(finite, kernel)
    return high - low > (np.maximum(jump, share * high) if share else jump)
