"""Pairs of which a common disparity was taken out, as m3depth.rectify does where cameras are turned towards each other.

The methods match such a pair as it is, and what they find becomes depth with the common disparity s given back: Z = f B
/ (d + s). A plane has d = m . r at the rays r = (x, y, 1), with the normal -m / |m|; with s, m becomes m + (0, 0, s).

They find no disparities below 0. So s may be no more than the least disparity of what the pair shows, which the
calibration does not tell: where it is more, the right image is moved to make up for it.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from m3depth.prediction.masks import unknown_where
from m3depth.rectification.pair import LEAST_PERCENTILE, MARGIN
from m3depth.stereo.pairs import in_grey
from m3depth.stereo.prediction import Prediction
from marssim.base.camera import StereoRig

SHARE = 0.05  # of the width; a smaller common disparity is put back by moving the right image
SEARCH_WIDTH = 256  # [px] to which larger images are reduced for a look at their disparities
NEAR = 0.5  # share of the width up to which disparities are searched, beyond the common one
BLOCK = 5  # [px] side of the matched window
ISLAND = 0.003  # share of the pixels that have to match at negative disparities together, so that these are true
LEAST = 0.25  # [px] disparity up to which a method may mean a negative one


def taken_out(
    shift: float,
    left: np.ndarray,
    right: np.ndarray,
    valid: tuple[np.ndarray | None, np.ndarray | None] = (None, None),
) -> float:
    """Return the part of a calibration's shift [px] that stays out while the pair is matched.

    None of a small one. All of a large one, as of images that m3depth.rectify wrote, unless some of the scene then has
    negative disparities, as semi-global matching finds it: then so much less that these are positive.

    Args:
        shift: The right camera's cx minus the left one's [px].
        left, right: The images, (H, W) or (H, W, 3) uint8.
        valid: Where each image shows the scene, (H, W) bool; None for everywhere.
    """
    width = left.shape[1]
    if shift <= SHARE * width:
        return 0.0
    least = _least_disparity(left, right, shift, valid)
    return shift if least >= 0 else max(0.0, shift + float(np.floor(least - MARGIN * width)))


def _least_disparity(
    left: np.ndarray, right: np.ndarray, shift: float, valid: tuple[np.ndarray | None, np.ndarray | None]
) -> float:
    """Return the least disparity [px] of a pair, of at least -shift; 0 if none is negative. Arguments: of taken_out."""
    height, width = left.shape[:2]
    reduction = max(1.0, width / SEARCH_WIDTH)
    size = (round(width / reduction), max(1, round(height / reduction)))
    eyes = [cv2.resize(in_grey(eye), size, interpolation=cv2.INTER_AREA) for eye in (left, right)]
    beyond = min(int(np.ceil(shift / reduction)) + 2, size[0] // 2)  # [px] disparity of the horizon, below 0
    reach = 16 * int(np.ceil((beyond + NEAR * size[0]) / 16))
    matcher = cv2.StereoSGBM.create(
        minDisparity=-beyond, numDisparities=reach, blockSize=BLOCK, P1=8 * BLOCK**2, P2=32 * BLOCK**2,
        disp12MaxDiff=1, preFilterCap=31, uniquenessRatio=10,
    )  # fmt: skip
    # Without padding OpenCV leaves columns empty at both sides. Matches inside of it are left out below.
    padded = [cv2.copyMakeBorder(eye, 0, 0, reach, beyond + BLOCK, cv2.BORDER_REPLICATE) for eye in eyes]
    disparity = matcher.compute(*padded)[:, reach : reach + size[0]].astype(np.float32) / 16
    place = np.arange(size[0]) - disparity
    negative = (disparity > -beyond + 0.5) & (disparity < -1) & (place >= 0) & (place <= size[0] - 1)
    for eye, mask in enumerate(valid):
        if mask is not None:
            shown = cv2.resize(mask.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
            at = np.arange(size[0])[None] if eye == 0 else np.clip(np.rint(place), 0, size[0] - 1).astype(int)
            negative &= np.take_along_axis(shown, np.broadcast_to(at, shown.shape), axis=1)
    count, labels, figures, _ = cv2.connectedComponentsWithStats(negative.astype(np.uint8))
    large = [n for n in range(1, count) if figures[n, cv2.CC_STAT_AREA] >= ISLAND * negative.size]
    if not large:
        return 0.0
    return max(-shift, reduction * float(np.percentile(disparity[np.isin(labels, large)], LEAST_PERCENTILE)))


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
        The maps of the true scene. Sky stays sky, and unknown stays unknown. What was found at a disparity of nearly 0
        becomes unknown, as it may be farther away than f B / shift.
    """
    if shift == 0:
        return prediction
    prediction = unknown_where(prediction, np.isfinite(prediction.depth) & (prediction.disparity <= LEAST))
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
    return replace(prediction, depth=depth, disparity=disparity.astype(np.float32), normal=normal)
