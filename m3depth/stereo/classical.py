"""Classical stereo on the CPU: the baselines that a learned network has to beat.

Every matcher is an estimator: `infer(left, right, rig) -> Prediction`. Disparities that no match was found for are
filled along the row (confidence 0), as KITTI's development kit does before it scores a method densely.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Literal

import cv2
import numpy as np

from m3depth.stereo.pairs import NEAREST, checked_pair, in_grey
from m3depth.stereo.plane_normals import fitted_normals
from m3depth.stereo.prediction import Prediction
from m3depth.stereo.window_costs import Cost, semi_global, window_costs, winners
from marssim.base.camera import StereoRig

WTA_BLOCK, SGM_BLOCK = 9, 5  # [px]
TEXTURE_WINDOW = 9  # [px]
PENALTIES: dict[str, tuple[int, int]] = {"sad": (200, 1600), "ssd": (60, 300), "ncc": (400, 3000)}  # of SGM


def _check_search(disparities: int | None, block: int) -> None:
    """Raise ValueError that names the setting that cannot work."""
    if disparities is not None and (disparities < 16 or disparities % 16):
        raise ValueError(f"disparities must be a positive multiple of 16, got {disparities}")
    if block < 1 or block % 2 == 0:
        raise ValueError(f"block must be odd and positive, got {block}")


@dataclass(frozen=True)
class SGBM:
    """OpenCV's semi-global block matching (Hirschmueller 2008), with its holes filled.

    disparities: width of the search [px], a multiple of 16; None: what reaches to 0.84 m with the given rig.
    block: side of the matched window [px], odd. uniqueness [%]: margin by which the best cost has to win. speckle [px]:
    smaller islands of disparity count as unmatched; one in the strip that the right eye does not see would otherwise
    be smeared along the row by the filling. texture [grey levels / px]: what has less of it along the row counts as
    unmatched; in a clear sky islands of more than speckle px of the detector's noise match at the shortest range, which
    a rover would take for walls.
    """

    disparities: int | None = None
    block: int = 3
    uniqueness: int = 10
    speckle: int = 400
    texture: float = 0.35
    normals_are_fitted: ClassVar[bool] = True

    def __post_init__(self) -> None:
        _check_search(self.disparities, self.block)
        if not self.texture >= 0:
            raise ValueError(f"texture must be 0 or more grey levels / px, got {self.texture}")

    def infer(self, left: np.ndarray, right: np.ndarray, rig: StereoRig) -> Prediction:
        """Depth, disparity, normals (fitted to the disparity) and confidence: 1 where matched, 0 where filled.

        left, right: (H, W) or (H, W, 3) uint8, RGB, rectified. Raises ValueError for wrong types or sizes.
        """
        return prediction_from_matches(self.match(left, right, rig), rig)

    def match(self, left: np.ndarray, right: np.ndarray, rig: StereoRig) -> np.ndarray:
        """(H, W) float32 disparity [px], NaN where nothing matches. Images and errors as in infer."""
        left, right = grey_pair(left, right, rig)
        reach = self.disparities or search_range(rig)
        # Without the padding OpenCV leaves the first `reach` columns empty. What matches inside it is no match.
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
            mode=cv2.StereoSGBM_MODE_SGBM,
        )
        disparity = matcher.compute(*padded)[:, reach:].astype(np.float32) / 16
        columns = np.arange(disparity.shape[1], dtype=np.float32)
        # Where there is no texture, and along the right border, ties end at 0 px: that is no match either.
        disparity[(disparity < 0.5) | (disparity > columns + 0.5)] = np.nan
        disparity[_row_texture(left) < self.texture] = np.nan
        return _without_speckles(disparity, self.speckle)


@dataclass(frozen=True)
class BlockMatching:
    """Windows compared by absolute (sad) or squared (ssd) differences or by normalised cross-correlation (ncc).

    aggregation: wta, the best cost takes it all; sgm, semi-global matching along eight paths (Hirschmueller 2008).
    Sub-pixel by a parabola; both eyes have to agree within 1 px; what does not is filled. block: side of the window
    [px], odd; None: 9, or 5 for sgm. disparities: width of the search [px], a multiple of 16; None: what reaches to
    0.84 m with the given rig. speckle: as SGBM's. These are the six classical methods of the paper (App. C).
    """

    cost: Cost = "sad"
    aggregation: Literal["wta", "sgm"] = "wta"
    block: int | None = None
    disparities: int | None = None
    speckle: int = 400
    normals_are_fitted: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if self.cost not in PENALTIES:
            raise ValueError(f"cost must be sad, ssd or ncc, got {self.cost!r}")
        if self.aggregation not in ("wta", "sgm"):
            raise ValueError(f"aggregation must be wta or sgm, got {self.aggregation!r}")
        _check_search(self.disparities, WTA_BLOCK if self.block is None else self.block)

    def infer(self, left: np.ndarray, right: np.ndarray, rig: StereoRig) -> Prediction:
        """As SGBM.infer."""
        return prediction_from_matches(self.match(left, right, rig), rig)

    def match(self, left: np.ndarray, right: np.ndarray, rig: StereoRig) -> np.ndarray:
        """As SGBM.match."""
        grey = grey_pair(left, right, rig)
        reach = min(self.disparities or search_range(rig), rig.camera.width)
        sgm = self.aggregation == "sgm"
        costs = window_costs(*grey, reach, self.cost, self.block or (SGM_BLOCK if sgm else WTA_BLOCK))
        return _without_speckles(winners(semi_global(costs, *PENALTIES[self.cost]) if sgm else costs), self.speckle)


def _row_texture(grey: np.ndarray) -> np.ndarray:
    """(H, W) float32, mean length of the gradient along the row [grey levels / px] over TEXTURE_WINDOW."""
    across = cv2.Sobel(grey, cv2.CV_32F, 1, 0, ksize=3, scale=1 / 8)
    return cv2.boxFilter(np.abs(across), -1, (TEXTURE_WINDOW, TEXTURE_WINDOW))


def _without_speckles(disparity: np.ndarray, size: int) -> np.ndarray:
    """Islands of at most `size` px, 2 px from their surroundings, and what is nearer to 0 than half a pixel, unmatched.

    disparity: (H, W) float32, NaN where unmatched. Returns the same.
    """
    fixed = np.where(disparity >= 0.5, np.round(disparity * 16), 0).astype(np.int16)
    cv2.filterSpeckles(fixed, 0, size, 2 * 16)
    return np.where(fixed > 0, disparity, np.float32(np.nan))


def search_range(rig: StereoRig) -> int:
    """Disparities [px] that reach to 0.84 m, or over the image's whole width if that is less.

    Rounded up to a multiple of 16, as OpenCV asks for: up to 15 px more than the image is wide.
    """
    return max(16, 16 * math.ceil(min(rig.fb / NEAREST, rig.camera.width) / 16))


def grey_pair(left: np.ndarray, right: np.ndarray, rig: StereoRig) -> tuple[np.ndarray, np.ndarray]:
    """Both images as (H, W) uint8. Raises ValueError as checked_pair does."""
    a, b = map(in_grey, checked_pair(left, right, rig))
    return a, b


def prediction_from_matches(disparity: np.ndarray, rig: StereoRig) -> Prediction:
    """Fill what has no match, and derive depth, normals and confidence.

    disparity: (H, W) float32 [px], NaN where there is no match. Depth and normals are NaN if the whole image has none.
    """
    filled = fill_background(disparity)
    depth = np.where(np.isnan(filled), np.float32(np.nan), rig.disparity_to_depth(filled))
    normal = np.where(np.isnan(depth)[..., None], np.float32(np.nan), fitted_normals(filled, rig.camera))
    return Prediction(depth, filled, normal, np.isfinite(disparity).astype(np.float32))


def fill_background(disparity: np.ndarray) -> np.ndarray:
    """Fill holes with the smaller of their two neighbours along the row: what is hidden belongs to the background.

    disparity: (H, W) float [px], NaN in holes. A hole at the border takes its one neighbour; a row without any value
    takes the smaller of the nearest rows' values, column by column. All NaN stays NaN. (KITTI development kit,
    interpolateBackground.)
    """
    rows = _fill_along_rows(disparity)
    return _fill_along_rows(rows.T).T.copy()


def _fill_along_rows(values: np.ndarray) -> np.ndarray:
    known = np.isfinite(values)
    width = values.shape[1]
    columns = np.arange(width)
    before = np.maximum.accumulate(np.where(known, columns, -1), axis=1)
    after = np.minimum.accumulate(np.where(known, columns, width)[:, ::-1], axis=1)[:, ::-1]
    padded = np.concatenate([values, np.full((len(values), 1), np.nan, values.dtype)], axis=1)  # -1 and width: NaN
    return np.fmin(np.take_along_axis(padded, before, axis=1), np.take_along_axis(padded, after, axis=1))
