"""The maps that an estimator returns for a stereo pair, and those of its steps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from m3depth.stereo.rows import RowFit


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
        row_fit: How the rows of the pair lay apart, where infer(..., align_rows=True) aligned them; None where they
            stayed as they are. The disparities are those of the aligned right image, from which
            m3depth.stereo.rows.columns_in_given_image leads to the given one.
    """

    depth: np.ndarray
    disparity: np.ndarray
    normal: np.ndarray | None
    confidence: np.ndarray
    row_fit: RowFit | None = None

    @property
    def is_sky(self) -> np.ndarray:
        """(H, W) bool, where the method sees sky or too far to measure; unknown depth is not sky."""
        return np.isposinf(self.depth)


class StepMap(NamedTuple):
    """The disparity of a pair after a step of a method that refines it step by step.

    Attributes:
        name: "first map", before any step; "step 1" and so on; or "result", at full size.
        working_size: Height and width of the images in which the method took the step [px].
        disparity: (H, W) float32 [px], at the size of the pair; 0 where depth is infinite, NaN where it is unknown.
    """

    name: str
    working_size: tuple[int, int]
    disparity: np.ndarray
