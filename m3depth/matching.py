"""Classical stereo on the CPU: the baselines that a learned network has to beat.

Every matcher is an estimator: `infer(left, right, rig) -> Prediction`. Disparities that no match was found for are
filled along the row (confidence 0), as KITTI's development kit does before it scores a method densely.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from m3depth.pairs import NEAREST, checked_pair
from m3depth.prediction import Prediction
from marssim.camera import PinholeCamera, StereoRig

SWAP_WIDTH, SWAP_SHARE = 256, 0.3  # of eyes_swapped
NORMAL_WINDOW = 15  # [px] side of the window that a normal is fitted in


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
    be smeared along the row by the filling.
    """

    disparities: int | None = None
    block: int = 3
    uniqueness: int = 10
    speckle: int = 400

    def __post_init__(self) -> None:
        _check_search(self.disparities, self.block)

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
        return disparity


@dataclass(frozen=True)
class BlockMatching:
    """Window matching, the best cost takes it all; sub-pixel by a parabola, both eyes have to agree within 1 px.

    cost: sum of absolute (sad) or squared (ssd) differences, or normalised cross-correlation (ncc), over a window of
    `block` px, odd. disparities: width of the search [px], a multiple of 16; None: what reaches to 0.84 m with the
    given rig.
    """

    cost: Literal["sad", "ssd", "ncc"] = "sad"
    block: int = 9
    disparities: int | None = None

    def __post_init__(self) -> None:
        if self.cost not in ("sad", "ssd", "ncc"):
            raise ValueError(f"cost must be sad, ssd or ncc, got {self.cost!r}")
        _check_search(self.disparities, self.block)

    def infer(self, left: np.ndarray, right: np.ndarray, rig: StereoRig) -> Prediction:
        """As SGBM.infer."""
        grey = grey_pair(left, right, rig)
        reach = min(self.disparities or search_range(rig), rig.camera.width)
        costs = self._costs(grey[0].astype(np.float32), grey[1].astype(np.float32), reach)  # (D, H, W)
        best = costs.argmin(axis=0)
        disparity = best + _parabola(costs, best)
        right_costs = np.full_like(costs, np.inf)
        for d in range(reach):
            right_costs[d, :, : costs.shape[2] - d] = costs[d, :, d:]
        right_best = right_costs.argmin(axis=0)
        partner = np.arange(costs.shape[2]) - best  # never negative: such costs are infinite
        agrees = np.abs(np.take_along_axis(right_best, partner, axis=1) - best) <= 1
        return prediction_from_matches(np.where(agrees, disparity, np.nan).astype(np.float32), rig)

    def _costs(self, left: np.ndarray, right: np.ndarray, reach: int) -> np.ndarray:
        """(D, H, W) float32 cost of every disparity; inf where the right image ends."""
        size = (self.block, self.block)
        costs = np.full((reach, *left.shape), np.inf, dtype=np.float32)
        if self.cost == "ncc":
            left, right = (_standardised(image, size) for image in (left, right))
        for d in range(reach):
            a, b = left[:, d:], right[:, : left.shape[1] - d]
            if self.cost == "sad":
                difference = np.abs(a - b)
            elif self.cost == "ssd":
                difference = (a - b) ** 2
            else:
                difference = 1 - a * b
            costs[d, :, d:] = cv2.boxFilter(difference, -1, size, borderType=cv2.BORDER_REPLICATE)
        return costs


def _standardised(image: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """The image less its local mean, over its local deviation: products of two such images correlate windows."""
    mean = cv2.boxFilter(image, -1, size, borderType=cv2.BORDER_REPLICATE)
    square = cv2.boxFilter(image * image, -1, size, borderType=cv2.BORDER_REPLICATE)
    return (image - mean) / np.sqrt(np.maximum(square - mean * mean, 1.0))


def _parabola(costs: np.ndarray, best: np.ndarray) -> np.ndarray:
    """(H, W) sub-pixel offset in [-0.5, 0.5] of the minimum through three costs; 0 at the ends of the search."""
    last = len(costs) - 1

    def at(index: np.ndarray) -> np.ndarray:
        return np.take_along_axis(costs, np.clip(index, 0, last)[None], axis=0)[0]

    before, here, after = at(best - 1), at(best), at(best + 1)
    inner = (best > 0) & (best < last) & np.isfinite(before) & np.isfinite(after)
    before, after = np.where(inner, before, here), np.where(inner, after, here)
    bend = before - 2 * here + after
    return np.where(bend > 0, np.clip((before - after) / (2 * np.where(bend > 0, bend, 1)), -0.5, 0.5), 0)


def eyes_swapped(left: np.ndarray, right: np.ndarray, rig: StereoRig) -> bool:
    """Whether the images match much better with the eyes exchanged: at least three tenths of them, and twice as much.

    A quick look with SGBM on images reduced to 256 columns; of clean and degraded simulated pairs at least 0.49 match
    the right way and at most 0.17 the wrong one, of a raw pair of Curiosity's Navcams 0.85 and 0.36.
    Images and errors as in SGBM.infer.
    """
    left, right = grey_pair(left, right, rig)
    scale = min(1.0, SWAP_WIDTH / rig.camera.width)
    small = rig.resized(round(rig.camera.width * scale), max(1, round(rig.camera.height * scale)))
    size = (small.camera.width, small.camera.height)
    a, b = (cv2.resize(image, size, interpolation=cv2.INTER_AREA) for image in (left, right))
    given, exchanged = (float(np.isfinite(SGBM().match(*eyes, small)).mean()) for eyes in ((a, b), (b, a)))
    return exchanged > SWAP_SHARE and exchanged > 2 * given


def search_range(rig: StereoRig) -> int:
    """Disparities [px] that reach to 0.84 m, or over the image's whole width if that is less.

    Rounded up to a multiple of 16, as OpenCV asks for: up to 15 px more than the image is wide.
    """
    return max(16, 16 * math.ceil(min(rig.fb / NEAREST, rig.camera.width) / 16))


def grey_pair(left: np.ndarray, right: np.ndarray, rig: StereoRig) -> tuple[np.ndarray, np.ndarray]:
    """Both images as (H, W) uint8. Raises ValueError as checked_pair does."""
    a, b = (
        cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) if image.ndim == 3 else image
        for image in checked_pair(left, right, rig)
    )
    return a, b


def prediction_from_matches(disparity: np.ndarray, rig: StereoRig) -> Prediction:
    """Fill what has no match, and derive depth, normals and confidence.

    disparity: (H, W) float32 [px], NaN where there is no match. Depth is NaN if the whole image has none.
    """
    filled = fill_background(disparity)
    depth = np.where(np.isnan(filled), np.float32(np.nan), rig.disparity_to_depth(filled))
    normal = normals_from_disparity(filled, rig.camera)
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


def normals_from_disparity(disparity: np.ndarray, camera: PinholeCamera, window: int = NORMAL_WINDOW) -> np.ndarray:
    """Surface normals of a disparity map: the plane that fits a window best.

    A plane in space is a plane in disparity too: n . P = h gives d = a u + b v + c, and n ~ (a fx, b fy, c) if u and v
    are counted from the principal point. So the least-squares slopes of the disparity are all that is needed.
    disparity: (H, W) float [px]; window: odd [px]. Returns (H, W, 3) float32, unit length, facing the camera; towards
    the camera where disparity is 0 or NaN.
    """
    known = np.nan_to_num(disparity, nan=0.0, posinf=0.0, neginf=0.0).astype(np.float64)
    offset = np.arange(window) - window // 2
    slope = offset / (offset.astype(float) ** 2).sum()
    mean = np.full(window, 1 / window)
    a = cv2.sepFilter2D(known, -1, slope, mean, borderType=cv2.BORDER_REFLECT_101)
    b = cv2.sepFilter2D(known, -1, mean, slope, borderType=cv2.BORDER_REFLECT_101)
    centre = cv2.sepFilter2D(known, -1, mean, mean, borderType=cv2.BORDER_REFLECT_101)
    rays = camera.rays()
    u, v = rays[..., 0] * camera.fx, rays[..., 1] * camera.fy  # from the principal point
    normal = -np.stack([a * camera.fx, b * camera.fy, centre - a * u - b * v], axis=-1)
    away = (np.einsum("ijk,ijk->ij", normal, rays) >= 0) | (known <= 0)
    normal[away] = -rays[away]
    return (normal / np.linalg.norm(normal, axis=-1, keepdims=True)).astype(np.float32)
