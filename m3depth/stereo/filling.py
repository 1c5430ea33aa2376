"""Filling of unknown pixels from the background, so that a sparse method answers everywhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from m3depth.stereo.plane_normals import fitted_normals
from m3depth.stereo.prediction import Prediction
from marssim.base.camera import StereoRig


def filled_prediction(prediction: Prediction, rig: StereoRig) -> Prediction:
    """Fill the disparity and the depth of a prediction where they are unknown; confidence is 0 there.

    Normals that are unknown there become those of planes that are fitted to the filled disparity.

    Args:
        prediction: The maps. Infinite depth is sky, which is known, whatever its disparity; any other pixel is unknown
            without a finite depth and a disparity above 0.
        rig: The cameras of the pair.
    """
    sky = np.isposinf(prediction.depth)
    unknown = ~sky & ~(np.isfinite(prediction.depth) & np.isfinite(prediction.disparity) & (prediction.disparity > 0))
    if not unknown.any():
        return prediction
    measured = np.where(sky, 0, np.where(unknown, np.nan, prediction.disparity)).astype(prediction.disparity.dtype)
    disparity = fill_background(measured)
    depth = np.where(unknown & np.isfinite(disparity), rig.disparity_to_depth(disparity), prediction.depth)
    confidence = np.where(unknown, 0, prediction.confidence).astype(np.float32)
    normal = prediction.normal
    if normal is not None and (bare := unknown & ~np.isfinite(normal).all(axis=-1)).any():
        normal = np.where(bare[..., None], fitted_normals(disparity, rig.camera), normal)
    return replace(
        prediction, disparity=disparity, depth=depth.astype(np.float32), confidence=confidence, normal=normal
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
