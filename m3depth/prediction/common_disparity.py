"""Pairs of which a common disparity was taken out, as m3depth.rectify does where cameras are turned towards each other.

The methods match such a pair as it is, and what they find becomes depth with the common disparity s given back: Z = f B
/ (d + s). A plane has d = m . r at the rays r = (x, y, 1), with the normal -m / |m|; with s, m becomes m + (0, 0, s).
"""

from __future__ import annotations

import numpy as np

from m3depth.stereo.prediction import Prediction
from marssim.base.camera import StereoRig

SHARE = 0.05  # of the width; a smaller common disparity is put back by moving the right image


def taken_out(shift: float, width: int) -> float:
    """Return the part of a calibration's shift [px] that stays out while the pair is matched: all of it or none."""
    return shift if shift > SHARE * width else 0.0


def nearest_without(nearest: float, rig: StereoRig, shift: float) -> float:
    """Return the depth [m] whose disparity is that of `nearest` [m] without a common disparity [px], at least 1 px."""
    return rig.fb / max(rig.fb / nearest - shift, 1.0)


def given_back(prediction: Prediction, rig: StereoRig, shift: float) -> Prediction:
    """Return a prediction with a common disparity given back.

    Args:
        prediction: What a method found in the pair without it.
        rig: The cameras of the images.
        shift: The common disparity [px].

    Returns:
        The maps of the true scene. Sky stays sky, and unknown stays unknown.
    """
    if shift == 0:
        return prediction
    measured = np.isfinite(prediction.depth) & (prediction.disparity > 0)
    disparity = np.where(measured, prediction.disparity + np.float32(shift), prediction.disparity)
    depth = np.where(measured, np.float32(rig.fb) / np.where(measured, disparity, 1), prediction.depth).astype(
        np.float32
    )
    normal = prediction.normal
    if normal is not None:
        along = (normal * rig.camera.rays()).sum(axis=-1)
        slope = (
            normal * np.where(measured, prediction.disparity / np.where(along < 0, along, np.nan), np.nan)[..., None]
        )
        slope[..., 2] += shift
        turned = -slope / np.linalg.norm(slope, axis=-1, keepdims=True)
        normal = np.where(np.isfinite(turned).all(axis=-1, keepdims=True), turned, normal).astype(np.float32)
    return Prediction(depth, disparity.astype(np.float32), normal, prediction.confidence)
