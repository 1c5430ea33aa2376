"""The maps that an estimator returns for a stereo pair."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Prediction:
    """Dense maps of the left image, at the input's size. Frame: left camera, x right, y down, z forward.

    Attributes:
        depth: (H, W) float32 [m], z along the optical axis; inf where the method sees sky or too far to measure, NaN
            where depth is unknown.
        disparity: (H, W) float32 [px], x_left - x_right; 0 where depth is infinite, NaN where it is unknown.
        normal: (H, W, 3) float32, unit length, facing the camera (n . ray < 0), NaN where it is unknown; None if the
            method gives none.
        confidence: (H, W) float32 in [0, 1]; 0 where depth is unknown.
    """

    depth: np.ndarray
    disparity: np.ndarray
    normal: np.ndarray | None
    confidence: np.ndarray

    @property
    def is_sky(self) -> np.ndarray:
        """(H, W) bool, where the method sees sky or too far to measure; unknown depth is not sky."""
        return np.isposinf(self.depth)
