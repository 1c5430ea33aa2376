"""Left-right consistency: a check of a prediction that needs no ground truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from m3depth.prediction.masks import unmeasured
from m3depth.prediction.settings import Infer
from m3depth.stereo.prediction import Prediction
from marssim.base.camera import StereoRig

AGREEMENT = 1.0  # [px] largest difference of both eyes' disparities that counts as agreement


def left_right_difference(
    infer: Infer, left: np.ndarray, right: np.ndarray, rig: StereoRig, prediction: Prediction, begins: float = 0.0
) -> np.ndarray:
    """Return how far the left eye's disparity is from the right eye's disparity of the same point.

    The right eye's disparities come from the mirrored pair with the eyes exchanged, which is again a rectified pair.
    Occluded pixels differ by what the other eye sees there instead.

    Args:
        infer: Predicts for a pair, as Estimator.infer does.
        left: (H, W) or (H, W, 3) uint8 left image.
        right: The right image, likewise.
        rig: The cameras of these images.
        prediction: What `infer` returned for them.
        begins: Column of `right` at which it begins to show the scene [px]: above 0 where it was moved to the right.

    Returns:
        (H, W) float32 [px]. NaN where the point lies beyond the right image's border, or a disparity is unknown or of a
        pixel that the method only filled in the right image; 0 where both are sky.
    """
    width = left.shape[1]
    mirrored = replace(rig, camera=replace(rig.camera, cx=width - 1 - rig.camera.cx))
    first, second = (np.ascontiguousarray(image[:, ::-1]) for image in (right, left))
    of_right = infer(first, second, mirrored)
    right_disparity = np.where(unmeasured(of_right), np.float32(np.nan), of_right.disparity)[:, ::-1]
    column = np.arange(width) - prediction.disparity  # columns of the right image
    inside = (column >= max(0.0, begins)) & (column <= width - 1)  # False where it is NaN
    column = np.where(inside, column, 0)
    before = column.astype(int)
    low, high = (np.take_along_axis(right_disparity, i, axis=1) for i in (before, np.minimum(before + 1, width - 1)))
    part = column - before
    other = np.where(part > 0, (1 - part) * low + part * high, low)
    return np.where(inside, np.abs(prediction.disparity - other), np.nan).astype(np.float32)
