"""What is scored of depth, disparity and normals, pixel by pixel; m3depth.evaluation.scores sums it up.

Rules, for every method alike:

- Scored are the pixels that the ground truth calls valid (those of 0.5 to 15 m; in the layouts of others every known
  one, or --depth-range) and whose true disparity is at most `MAX_DISPARITY`; nearer ones are scored apart, as "near".
- No scored pixel is dropped. Depth that is unknown (NaN), infinite, not positive or beyond 80 m counts as 80 m, and
  under 0.01 m as 0.01 m; of true depth (of other layouts, ours ends at 15 m) both limits hold too. An unknown or
  infinite disparity counts as 0 px; an unknown normal as 180 deg off. `density` tells the share of pixels that had a
  finite, positive depth.
- Every figure is given twice: `per_image`, the mean over images of the image's figure, and `pooled`, over all pixels.

Memory does not grow with the number of pixels. The pooled median angle comes from a histogram with bins of 0.01 deg.
Depth and normal figures are those of the paper (Sec. V-B; the table of normal metrics); angles are signed, so a normal
that points away from the camera is 180 deg off.
"""

from __future__ import annotations

from typing import Any, Protocol

import cv2
import numpy as np

from m3depth.stereo.pairs import MAX_DISPARITY, in_grey
from marssim.base.camera import MAX_DEPTH, StereoRig

DEPTH_CAP = 80.0  # [m]
DEPTH_FLOOR = 0.01  # [m]
INTERVAL_EDGES = np.arange(0.0, MAX_DEPTH + 1)  # [m] the paper's 15 depth intervals (a, b]
KINDS = ("all", "visible", "occluded", "rock", "ground", "texture_poor", "near")
POOR_TEXTURE = 2.5  # [grey levels] standard deviation in 9 x 9 px below which a pixel counts as texture-poor

DEPTH_TERMS = (
    "abs_rel", "sq_rel", "rmse", "log10", "delta1", "delta2", "delta3", "mae", "epe", "bad1", "bad3", "density",
)  # fmt: skip
NORMAL_TERMS = ("mean", "rmse", "within_11.25", "within_22.5", "within_30")


class StereoTruth(Protocol):
    """What is known about a pair: the fields of a marssim.base.dataset.dataset sample that scoring reads.

    left: (H, W, 3) uint8. depth [m], disparity [px]: (H, W). normal: (H, W, 3), 0 where unknown. valid, occluded:
    (H, W) bool. rock: (H, W) int, 0 where there is no rock. meta: "pose" is (4, 4) left camera to world, if known.
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


def known_depth(depth: np.ndarray) -> np.ndarray:
    """(...) bool: the method committed itself to a finite, positive depth."""
    return np.isfinite(depth) & (depth > 0)


def capped_depth(depth: np.ndarray) -> np.ndarray:
    """(...) float64 [m]: the depth that is scored, 0.01 to 80 m; 80 m where it is unknown, infinite or not positive."""
    known = known_depth(depth)
    return np.clip(np.where(known, depth, DEPTH_CAP).astype(np.float64), DEPTH_FLOOR, DEPTH_CAP)


def depth_terms(
    depth: np.ndarray, disparity: np.ndarray, true_depth: np.ndarray, true_disparity: np.ndarray
) -> np.ndarray:
    """(N, len(DEPTH_TERMS)) float64 of N scored pixels; their mean is the figure (RMSE: its square).

    depth, disparity: (N,) as predicted, true_depth, true_disparity: (N,) finite and positive. Depth figures in metres
    or ratios (paper, Sec. V-B), epe in px, bad1 and bad3: share of disparities off by more than 1 and 3 px.
    """
    predicted, true = capped_depth(depth), capped_depth(true_depth)
    error = np.abs(predicted - true)
    ratio = np.maximum(predicted / true, true / predicted)
    guess = np.where(np.isfinite(disparity), disparity, 0).astype(np.float64)
    off = np.abs(guess - true_disparity)
    return np.stack(
        [
            error / true, error**2 / true, error**2, np.abs(np.log10(predicted / true)),
            ratio < 1.25, ratio < 1.25**2, ratio < 1.25**3, error, off, off > 1, off > 3, known_depth(depth),
        ],
        axis=-1,
    )  # fmt: skip


def angle_between(predicted: np.ndarray, true: np.ndarray) -> np.ndarray:
    """Angle between vectors [deg], exact for small angles as well: 2 atan(|a - b| / |a + b|) of equally long a and b.

    predicted, true: (..., 3), any length. Returns (...) in [0, 180]; 180 where `predicted` is not finite or zero.
    """
    x, y, z = (predicted[..., i].astype(np.float64) for i in range(3))
    u, v, w = (true[..., i].astype(np.float64) for i in range(3))
    with np.errstate(invalid="ignore", over="ignore"):
        length = np.sqrt(x * x + y * y + z * z)
        known = np.isfinite(length) & (length > 1e-6)
        scale = np.sqrt(u * u + v * v + w * w) / np.where(known, length, 1)  # makes both as long as `true`
        x, y, z = x * scale, y * scale, z * scale
        apart = (x - u) ** 2 + (y - v) ** 2 + (z - w) ** 2
        together = (x + u) ** 2 + (y + v) ** 2 + (z + w) ** 2
        angle = np.degrees(2 * np.arctan2(np.sqrt(apart), np.sqrt(together)))
    return np.where(known, angle, 180.0)


def normal_terms(angle: np.ndarray) -> np.ndarray:
    """(N, len(NORMAL_TERMS)) float64 of N angular errors [deg]; their mean is the figure (RMSE: its square)."""
    return np.stack([angle, angle**2, angle < 11.25, angle < 22.5, angle < 30], axis=-1).astype(np.float64)


def pixel_kinds(sample: StereoTruth, max_disparity: float = MAX_DISPARITY) -> dict[str, np.ndarray]:
    """(H, W) bool masks by kind; every kind but "near" lies within "all"."""
    known = sample.valid & np.isfinite(sample.depth) & (sample.depth > 0) & (sample.disparity > 0)
    scored = known & (sample.disparity <= max_disparity)
    rock = sample.rock > 0
    return {
        "all": scored,
        "visible": scored & ~sample.occluded,
        "occluded": scored & sample.occluded,
        "rock": scored & rock,
        "ground": scored & ~rock,
        "texture_poor": scored & texture_poor(sample.left),
        "near": known & (sample.disparity > max_disparity),
    }


def texture_poor(image: np.ndarray) -> np.ndarray:
    """(H, W) bool: grey levels vary by less than 2.5 (standard deviation) within 9 x 9 px.

    image: (H, W) or (H, W, 3) uint8.
    """
    return grey_deviation(image) < POOR_TEXTURE


def grey_deviation(image: np.ndarray) -> np.ndarray:
    """(H, W) float32: standard deviation of the grey levels within 9 x 9 px. image: (H, W) or (H, W, 3) uint8."""
    grey = in_grey(image).astype(np.float32)
    mean = cv2.boxFilter(grey, -1, (9, 9), borderType=cv2.BORDER_REFLECT_101)
    square = cv2.boxFilter(grey * grey, -1, (9, 9), borderType=cv2.BORDER_REFLECT_101)
    return np.sqrt(np.maximum(square - mean * mean, 0))
