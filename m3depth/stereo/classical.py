"""Classical stereo on the CPU: the baselines of a learned network.

Every matcher is an estimator: `infer(left, right, rig) -> Prediction`. Pixels without a match are filled along the row
(with confidence 0), as KITTI's development kit does before it scores a method densely.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from numbers import Integral
from typing import ClassVar, Literal

import cv2
import numpy as np

from m3depth.stereo.filling import fill_background
from m3depth.stereo.pairs import checked_pair, in_grey, largest_disparity
from m3depth.stereo.plane_normals import fitted_normals
from m3depth.stereo.prediction import Prediction
from m3depth.stereo.window_costs import Cost, semi_global, window_costs, winners
from marssim.base.camera import StereoRig

MODES = {5: cv2.StereoSGBM_MODE_SGBM, 8: cv2.StereoSGBM_MODE_HH}  # of OpenCV, by the number of directions
SGBM_BLOCK = 15  # [px] largest window; of 21 px, up to all matches along 8 directions are lost
SGBM_REACH = 2032  # [px] largest search of OpenCV, which keeps 16 times the disparity in 16 bits
WTA_BLOCK, SGM_BLOCK = 9, 5  # default side of BlockMatching's window [px]
TEXTURE_WINDOW = 9  # side of the window in which texture is measured [px]
# Penalties of semi-global matching for a disparity change by 1 px and by more, in units of the costs.
PENALTIES: dict[str, tuple[int, int]] = {"sad": (200, 1600), "ssd": (60, 300), "ncc": (400, 3000)}


def check_search(disparities: int | None, block: int, **other: int) -> None:
    """Raise ValueError that names the setting that cannot work; `other` settings must be 0 or more."""
    for name, value in {"disparities": disparities, "block": block, **other}.items():
        whole = isinstance(value, Integral) and not isinstance(value, bool)
        if not whole and (name, value) != ("disparities", None):
            raise ValueError(f"{name} must be a whole number, got {value!r}")
    if negative := [name for name, value in other.items() if value < 0]:
        raise ValueError(f"{negative[0]} must be 0 or more, got {other[negative[0]]}")
    if disparities is not None and (disparities < 16 or disparities % 16):
        raise ValueError(f"disparities must be a positive multiple of 16, got {disparities}")
    if block < 1 or block % 2 == 0:
        raise ValueError(f"block must be odd and positive, got {block}")


class Matcher(ABC):
    """An estimator that only matches: depth and normals follow from its disparity."""

    normals_are_fitted: ClassVar[bool] = True
    """Its normals are planes fitted to its disparity; see Estimator."""

    @abstractmethod
    def match(self, left: np.ndarray, right: np.ndarray, rig: StereoRig) -> np.ndarray:
        """Match without filling: (H, W) float32 disparity [px], NaN where nothing matches.

        Args:
            left: (H, W) or (H, W, 3) uint8, RGB, rectified.
            right: The right image, likewise.
            rig: The cameras of these images.

        Raises:
            ValueError: Images of a wrong type or size.
        """

    def infer(self, left: np.ndarray, right: np.ndarray, rig: StereoRig) -> Prediction:
        """Estimate depth, disparity, normals (fitted to the disparity) and confidence (1 matched, 0 filled).

        Args:
            left, right: (H, W) or (H, W, 3) uint8, RGB, rectified.
            rig: The cameras of these images.

        Raises:
            ValueError: Images of a wrong type or size.
        """
        return prediction_from_matches(self.match(left, right, rig), rig)


@dataclass(frozen=True)
class SGBM(Matcher):
    """OpenCV's semi-global block matching (Hirschmueller 2008), with its holes filled.

    Raises:
        ValueError: A setting that cannot work; the message names it.
    """

    directions: Literal[5, 8] = 5
    """Number of directions from which costs are summed: 5 from above and from the sides (OpenCV's MODE_SGBM), or all 8
    (MODE_HH), which takes about twice as long. On ground whose disparity grows downwards, 5 directions are biased
    towards smaller disparities, by a fifth to half a pixel.
    """
    disparities: int | None = None
    """Width of the search [px], a multiple of 16 up to 2032; None reaches to 0.84 m with the given rig, or 2032 px."""
    block: int = 3
    """Side of the matched window [px], odd, up to 15: larger ones lose matches, since OpenCV sums costs in 16 bits."""
    uniqueness: int = 10
    """Margin by which the best cost has to win [%]."""
    speckle: int = 400
    """Islands of disparity with fewer pixels count as unmatched.

    Otherwise, filling would smear an island in the strip that only the left camera sees along its whole row.
    """
    texture: float = 0.35
    """Pixels with less texture along the row count as unmatched [grey levels / px].

    In a clear sky, islands of noise larger than `speckle` match at the shortest range; a rover would take them for
    walls.
    """

    def __post_init__(self) -> None:
        check_search(self.disparities, self.block, uniqueness=self.uniqueness, speckle=self.speckle)
        if self.block > SGBM_BLOCK:
            reason = "larger ones lose matches, since OpenCV sums costs in 16 bits"
            raise ValueError(f"block must be at most {SGBM_BLOCK}, got {self.block}: {reason}")
        if self.disparities is not None and self.disparities > SGBM_REACH:
            raise ValueError(f"disparities must be at most {SGBM_REACH}, got {self.disparities}")
        if self.directions not in MODES:
            raise ValueError(f"directions must be 5 or 8, got {self.directions}")
        if not self.texture >= 0:
            raise ValueError(f"texture must be 0 or more grey levels / px, got {self.texture}")

    def match(self, left: np.ndarray, right: np.ndarray, rig: StereoRig) -> np.ndarray:
        """Return the disparity of matches, as Matcher.match does."""
        left, right = grey_pair(left, right, rig)
        if left.shape[1] == 1:  # no disparity, and OpenCV refuses such images
            return np.full(left.shape, np.nan, np.float32)
        reach = self.disparities or min(search_range(rig), SGBM_REACH)
        # Without padding OpenCV leaves the first `reach` columns empty. A match inside the padding is discarded below.
        padded = [cv2.copyMakeBorder(image, 0, 0, reach, 0, cv2.BORDER_REPLICATE) for image in (left, right)]
        matcher = cv2.StereoSGBM.create(
            minDisparity=0,
            numDisparities=reach,
            blockSize=self.block,
            P1=8 * self.block**2,
            P2=32 * self.block**2,
            disp12MaxDiff=1,
            preFilterCap=31,
            uniquenessRatio=self.uniqueness,
            speckleWindowSize=self.speckle,
            speckleRange=2,
            mode=MODES[self.directions],
        )
        disparity = matcher.compute(*padded)[:, reach:].astype(np.float32) / 16
        columns = np.arange(disparity.shape[1], dtype=np.float32)
        # Without texture, and along the right border, ties end at 0 px, which is not a match either.
        disparity[(disparity < 0.5) | (disparity > columns + 0.5)] = np.nan
        disparity[_row_texture(left) < self.texture] = np.nan
        return without_speckles(disparity, self.speckle)


@dataclass(frozen=True)
class BlockMatching(Matcher):
    """Matching of windows: the six classical methods of the paper (App. C).

    Disparities are refined to sub-pixels by a parabola. The matches of both images have to agree within 1 px; pixels
    where they do not are filled.

    Raises:
        ValueError: A setting that cannot work; the message names it.
    """

    cost: Cost = "sad"
    """How windows are compared: by absolute (sad) or squared (ssd) differences or normalised cross-correlation (ncc).
    """
    aggregation: Literal["wta", "sgm"] = "wta"
    """wta takes the best cost; sgm is semi-global matching along eight paths (Hirschmueller 2008)."""
    block: int | None = None
    """Side of the window [px], odd; None is 9, or 5 with sgm."""
    disparities: int | None = None
    """Width of the search [px], a multiple of 16; None reaches to 0.84 m with the given rig."""
    speckle: int = 400
    """Islands of disparity with fewer pixels count as unmatched."""

    def __post_init__(self) -> None:
        if self.cost not in PENALTIES:
            raise ValueError(f"cost must be sad, ssd or ncc, got {self.cost!r}")
        if self.aggregation not in ("wta", "sgm"):
            raise ValueError(f"aggregation must be wta or sgm, got {self.aggregation!r}")
        check_search(self.disparities, WTA_BLOCK if self.block is None else self.block, speckle=self.speckle)

    def match(self, left: np.ndarray, right: np.ndarray, rig: StereoRig) -> np.ndarray:
        """Return the disparity of matches, as Matcher.match does."""
        grey = grey_pair(left, right, rig)
        reach = min(self.disparities or search_range(rig), rig.camera.width)
        sgm = self.aggregation == "sgm"
        costs = window_costs(*grey, reach, self.cost, self.block or (SGM_BLOCK if sgm else WTA_BLOCK))
        return without_speckles(winners(semi_global(costs, *PENALTIES[self.cost]) if sgm else costs), self.speckle)


def _row_texture(grey: np.ndarray) -> np.ndarray:
    """Return the mean gradient along the row over TEXTURE_WINDOW: (H, W) float32 [grey levels / px]."""
    across = cv2.Sobel(grey, cv2.CV_32F, 1, 0, ksize=3, scale=1 / 8)
    return cv2.boxFilter(np.abs(across), -1, (TEXTURE_WINDOW, TEXTURE_WINDOW))


def without_speckles(disparity: np.ndarray, size: int) -> np.ndarray:
    """Mark small islands and near-zero disparities as unmatched.

    An island has at most `size` pixels and differs by over 2 px from its surroundings; near zero is below half a pixel.

    Args:
        disparity: (H, W) float32 [px], NaN where unmatched.
        size: Pixels of the largest island that is removed.

    Returns:
        (H, W) float32 [px], NaN where unmatched.
    """
    unit = 16  # of a pixel, as in OpenCV's disparities; a smaller one where these would not fit into 16 bits
    while unit > 1 and np.nanmax(disparity, initial=0) * unit > np.iinfo(np.int16).max:
        unit //= 2
    fixed = np.where(disparity >= 0.5, np.round(disparity * unit), 0).astype(np.int16)
    cv2.filterSpeckles(fixed, 0, size, 2 * unit)
    return np.where(fixed > 0, disparity, np.float32(np.nan))


def search_range(rig: StereoRig) -> int:
    """Return the disparities [px] that reach to 0.84 m, or over the whole image width if that is less.

    The number is rounded up to a multiple of 16, as OpenCV requires, so it may exceed the width by up to 15 px.
    """
    return max(16, 16 * math.ceil(largest_disparity(rig) / 16))


def grey_pair(left: np.ndarray, right: np.ndarray, rig: StereoRig) -> tuple[np.ndarray, np.ndarray]:
    """Return both images as (H, W) uint8. Raises ValueError as checked_pair does.

    Args:
        left: (H, W) or (H, W, 3) uint8, RGB, rectified.
        right: The right image, likewise.
        rig: The cameras of these images.
    """
    a, b = map(in_grey, checked_pair(left, right, rig))
    return a, b


def prediction_from_matches(disparity: np.ndarray, rig: StereoRig) -> Prediction:
    """Fill holes, and derive depth, normals and confidence.

    Args:
        disparity: (H, W) float32 [px], NaN where there is no match.
        rig: The cameras of the images.

    Returns:
        A Prediction whose confidence is 1 where matched and 0 where filled. Depth and normals are NaN if the whole
        image has no match.
    """
    filled = fill_background(disparity)
    depth = np.where(np.isnan(filled), np.float32(np.nan), rig.disparity_to_depth(filled))
    normal = np.where(np.isnan(depth)[..., None], np.float32(np.nan), fitted_normals(filled, rig.camera))
    return Prediction(depth, filled, normal, np.isfinite(disparity).astype(np.float32))
