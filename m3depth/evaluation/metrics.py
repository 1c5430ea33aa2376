"""Errors of depth, disparity and normals, pixel by pixel, and the rules of scoring.

Rules, for every method alike:

- Scored are the pixels that the ground truth calls valid (those of 0.5 to 15 m; in the layouts of others every known
  one, or --depth-range) and whose true disparity is at most `MAX_DISPARITY`. Nearer pixels are scored separately, as
  "near".
- No scored pixel is dropped. Depth that is unknown (NaN), infinite, not positive or beyond 80 m counts as 80 m, and
  under 0.01 m as 0.01 m. Both limits also hold for true depth (of other layouts; that of marssim ends at 15 m). An
  unknown or infinite disparity counts as 0 px, an unknown normal as 180 deg off. `density` is the share of pixels with
  a finite, positive depth.
- Every figure is given twice: `per_image`, the mean over images of the image's figure, and `pooled`, over all pixels.

m3depth.evaluation.scores sums them up, in memory that does not grow with the number of pixels: the pooled median angle
comes from a histogram with bins of 0.01 deg. Depth and normal figures are those of the paper (Sec. V-B; the table of
normal metrics). Normals are compared with their sign: the opposite of the true normal is 180 deg off.
"""

from __future__ import annotations

from typing import Any, Protocol

import cv2
import numpy as np

from m3depth.evaluation.surfaces import on_slab
from m3depth.stereo.pairs import MAX_DISPARITY, in_grey
from marssim.base.camera import MAX_DEPTH, StereoRig

DEPTH_CAP = 80.0  # [m] what unknown and larger depths count as
DEPTH_FLOOR = 0.01  # [m] what smaller depths count as
INTERVAL_EDGES = np.arange(0.0, MAX_DEPTH + 1)  # [m] the paper's 15 depth intervals (a, b]
# Kinds of pixels that have figures of their own.
KINDS = ("all", "visible", "occluded", "rock", "slab", "ground", "rover", "texture_poor", "near")
POOR_TEXTURE = 2.5  # [grey levels] standard deviation in 9 x 9 px below which a pixel counts as texture-poor

# Terms of depth_terms and normal_terms, in order; their means are the figures.
DEPTH_TERMS = (
    "abs_rel", "sq_rel", "rmse", "log10", "delta1", "delta2", "delta3", "mae", "epe", "bad1", "bad2", "bad3", "d1",
    "density",
)  # fmt: skip
NORMAL_TERMS = ("mean", "rmse", "within_11.25", "within_22.5", "within_30")


class StereoTruth(Protocol):
    """The ground truth of a pair: the fields of a marssim.base.dataset.dataset sample that scoring reads.

    Attributes:
        left: (H, W, 3) uint8 left image.
        depth: (H, W) depth [m].
        disparity: (H, W) disparity [px] as the images show it; it need not be f B / depth.
        normal: (H, W, 3) normals in the camera's frame, 0 where unknown.
        valid: (H, W) bool, the pixels that count.
        occluded: (H, W) bool, the pixels that the right eye does not see.
        rock: (H, W) int number of the rock, 0 where there is none, -1 on the rover itself.
        rig: The cameras.
        meta: "pose" is the (4, 4) matrix from the left camera to the world, if it is known; "surface_ids" tells
            slabs from other rocks (m3depth.evaluation.surfaces).
    """

    left: np.ndarray
    depth: np.ndarray
    disparity: np.ndarray
    normal: np.ndarray
    valid: np.ndarray
    occluded: np.ndarray
    rock: np.ndarray
    rig: StereoRig
    meta: dict[str, Any]


def has_depth(depth: np.ndarray) -> np.ndarray:
    """Return where depth (...) [m] is finite and positive, (...) bool."""
    return np.isfinite(depth) & (depth > 0)


def capped_depth(depth: np.ndarray) -> np.ndarray:
    """Return the depth that is scored, (...) float64 [m], 0.01 to 80 m.

    It is 80 m where `depth`, (...) [m], is unknown, infinite or not positive.
    """
    valid = has_depth(depth)
    return np.clip(np.where(valid, depth, DEPTH_CAP).astype(np.float64), DEPTH_FLOOR, DEPTH_CAP)


def depth_terms(
    depth: np.ndarray, disparity: np.ndarray, true_depth: np.ndarray, true_disparity: np.ndarray
) -> np.ndarray:
    """Return the terms of the depth figures at N scored pixels (paper, Sec. V-B).

    Args:
        depth: (N,) predicted depth [m].
        disparity: (N,) predicted disparity [px].
        true_depth: (N,) true depth [m], finite and positive.
        true_disparity: (N,) true disparity [px], finite.

    Returns:
        (N, len(DEPTH_TERMS)) float64; the mean of a column is the figure (of RMSE: its square). Depth terms are in
        metres or ratios, epe in px; bad1, bad2 and bad3 count disparities off by more than 1, 2 and 3 px, d1 those off
        by more than 3 px and by more than 5 % of the true disparity (D1 of KITTI 2015, Menze and Geiger 2015).
    """
    predicted, true = capped_depth(depth), capped_depth(true_depth)
    error = np.abs(predicted - true)
    ratio = np.maximum(predicted / true, true / predicted)
    guess = np.where(np.isfinite(disparity), disparity, 0).astype(np.float64)
    off = np.abs(guess - true_disparity)
    is_d1 = (off > 3) & (off > 0.05 * np.abs(true_disparity))
    return np.stack(
        [
            error / true, error**2 / true, error**2, np.abs(np.log10(predicted / true)),
            ratio < 1.25, ratio < 1.25**2, ratio < 1.25**3, error, off, off > 1, off > 2, off > 3, is_d1,
            has_depth(depth),
        ],
        axis=-1,
    )  # fmt: skip


def angle_between(predicted: np.ndarray, true: np.ndarray) -> np.ndarray:
    """Return the angle between vectors [deg], exact for small angles too.

    It is 2 atan(|a - b| / |a + b|) of equally long a and b.

    Args:
        predicted: (..., 3) vectors of any length.
        true: (..., 3) vectors of any length.

    Returns:
        (...) angles in [0, 180]; 180 where `predicted` is zero or not finite.
    """
    x, y, z = (predicted[..., i].astype(np.float64) for i in range(3))
    u, v, w = (true[..., i].astype(np.float64) for i in range(3))
    with np.errstate(invalid="ignore", over="ignore"):
        length = np.sqrt(x * x + y * y + z * z)
        valid = np.isfinite(length) & (length > 1e-6)
        scale = np.sqrt(u * u + v * v + w * w) / np.where(valid, length, 1)  # makes both as long as `true`
        x, y, z = x * scale, y * scale, z * scale
        apart = (x - u) ** 2 + (y - v) ** 2 + (z - w) ** 2
        together = (x + u) ** 2 + (y + v) ** 2 + (z + w) ** 2
        angle = np.degrees(2 * np.arctan2(np.sqrt(apart), np.sqrt(together)))
    return np.where(valid, angle, 180.0)


def normal_terms(angle: np.ndarray) -> np.ndarray:
    """Return the terms of the normal figures of N angular errors [deg].

    Returns:
        (N, len(NORMAL_TERMS)) float64; the mean of a column is the figure (of RMSE: its square).
    """
    return np.stack([angle, angle**2, angle < 11.25, angle < 22.5, angle < 30], axis=-1).astype(np.float64)


def pixel_kinds(sample: StereoTruth, max_disparity: float = MAX_DISPARITY) -> dict[str, np.ndarray]:
    """Return masks (H, W) bool of the scored pixels by kind; every kind but "near" lies within "all".

    Args:
        sample: The ground truth.
        max_disparity: Pixels of a larger true disparity [px] are "near".
    """
    valid = sample.valid & has_depth(sample.depth)
    scored = valid & (sample.disparity <= max_disparity)
    slab = on_slab(sample)
    return {
        "all": scored,
        "visible": scored & ~sample.occluded,
        "occluded": scored & sample.occluded,
        "rock": scored & (sample.rock > 0) & ~slab,
        "slab": scored & slab,
        "ground": scored & (sample.rock == 0),
        "rover": scored & (sample.rock < 0),
        "texture_poor": scored & texture_poor(sample.left),
        "near": valid & (sample.disparity > max_disparity),
    }


def texture_poor(image: np.ndarray) -> np.ndarray:
    """Return where the grey levels of an image vary by less than 2.5 (standard deviation) within 9 x 9 px.

    Args:
        image: (H, W) or (H, W, 3) uint8.

    Returns:
        (H, W) bool.
    """
    return grey_deviation(image) < POOR_TEXTURE


def grey_deviation(image: np.ndarray) -> np.ndarray:
    """Return the standard deviation of the grey levels within 9 x 9 px.

    Args:
        image: (H, W) or (H, W, 3) uint8.

    Returns:
        (H, W) float32 [grey levels].
    """
    grey = in_grey(image).astype(np.float32)
    mean = cv2.boxFilter(grey, -1, (9, 9), borderType=cv2.BORDER_REFLECT_101)
    square = cv2.boxFilter(grey * grey, -1, (9, 9), borderType=cv2.BORDER_REFLECT_101)
    return np.sqrt(np.maximum(square - mean * mean, 0))
