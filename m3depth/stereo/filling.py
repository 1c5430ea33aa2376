"""Filling of unknown pixels from the background, so that a sparse method answers everywhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from m3depth.stereo.prediction import Prediction
from marssim.base.camera import StereoRig


def filled_prediction(prediction: Prediction, rig: StereoRig) -> Prediction:
    """Fill the disparity and the depth of a prediction where they are unknown; confidence is 0 there.

    Args:
        prediction: The maps; the sky, whose disparity is 0, is known.
        rig: The cameras of the pair.
    """
    unknown = ~np.isfinite(prediction.disparity)
    if not unknown.any():
        return prediction
    disparity = fill_background(prediction.disparity)
    found = unknown & np.isfinite(disparity)
    depth = np.where(found, rig.disparity_to_depth(disparity), prediction.depth)
    confidence = np.where(unknown, 0, prediction.confidence)
    return replace(
        prediction, disparity=disparity, depth=depth.astype(np.float32), confidence=confidence.astype(np.float32)
    )


def fill_background(disparity: np.ndarray) -> np.ndarray:
    """Fill holes with the smaller of their two neighbours along the row: hidden pixels belong to the background.

    A hole at the border takes its one neighbour. A row without any value takes the smaller of the nearest rows' values,
    column by column. An image without any value stays NaN. (KITTI development kit, interpolateBackground.)

    Args:
        disparity: (H, W) float [px], NaN in holes.

    Returns:
        (H, W) of the same type.
    """
    rows = _fill_along_rows(disparity)
    return _fill_along_rows(rows.T).T.copy()


def _fill_along_rows(values: np.ndarray) -> np.ndarray:
    valid = np.isfinite(values)
    width = values.shape[1]
    columns = np.arange(width)
    before = np.maximum.accumulate(np.where(valid, columns, -1), axis=1)
    after = np.minimum.accumulate(np.where(valid, columns, width)[:, ::-1], axis=1)[:, ::-1]
    gap = np.full((len(values), 1), np.nan, values.dtype)
    padded = np.concatenate([values, gap], axis=1)  # the indices -1 and width read the gap
    return np.fmin(np.take_along_axis(padded, before, axis=1), np.take_along_axis(padded, after, axis=1))
