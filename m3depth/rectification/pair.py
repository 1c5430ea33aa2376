"""Rectify a raw pair: choose the views, match the rows, take out what is left over, and resample once."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import scipy

from m3depth.rectification.matches import matched_points
from m3depth.rectification.raw_image import RawImage, for_matching
from m3depth.rectification.row_errors import POWERS, RowCorrection, RowErrors, fit_rows, row_errors
from marssim.base.calibration.cameras import PosedCamera, PosedPair
from marssim.base.calibration.orientation import RectifiedView, rectified_view
from marssim.base.calibration.rectified import Calibration
from marssim.base.images.resampling import Source, rectifying, resample, unchanged

APART = 0.05  # share of the width by which the contents must lie apart before a common offset is taken out
MARGIN = 0.02  # share of the width that the least disparity keeps
LEAST_PERCENTILE = 1.0  # of the disparities, which counts as the least one
REACH, WIDE_REACH = 0.03, 0.12  # shares of the height by which rows may lie apart, with a calibration and without
DISPARITY_STEP = 0.1  # share of the width by which a match's disparity may differ from those of its neighbours
NEIGHBOURS = 9
ROUNDS = 2  # of fitting rows with six terms; the second takes out what the first left


@dataclass(frozen=True)
class Matches:
    """Points that both images show, without wrong ones.

    Attributes:
        left, right: (N, 2) places in the rectified images [px].
        raw_left, raw_right: (N, 2) the same points in the raw images [px].
        before, after: How far their rows lie apart in the raw images, and in the rectified ones.
    """

    left: np.ndarray
    right: np.ndarray
    raw_left: np.ndarray
    raw_right: np.ndarray
    before: RowErrors
    after: RowErrors

    @property
    def disparity(self) -> np.ndarray:
        """(N,) x_left - x_right in the rectified images [px]."""
        return self.left[:, 0] - self.right[:, 0]


@dataclass(frozen=True)
class RectifiedPair:
    """A rectified pair.

    Attributes:
        left, right: (H, W) or (H, W, 3) images, of the raw images' type; 0 where they show nothing.
        left_valid, right_valid: (H, W) bool, where they show what the raw images show.
        view: The rectified cameras; None without a calibration.
        matches: Points that both images show; None where too few were found to judge the rows.
        removed: What was taken out of the right image's rows beside the calibration; None if nothing was.
        cameras: The calibration; None without one.
        given: The calibration of the images as they are, where there is none of the raw cameras and flags or a file
            give the scale nevertheless.
    """

    left: np.ndarray
    right: np.ndarray
    left_valid: np.ndarray
    right_valid: np.ndarray
    view: RectifiedView | None
    matches: Matches | None
    removed: RowCorrection | None
    cameras: PosedPair | None
    given: Calibration | None = None

    @property
    def calibration(self) -> Calibration | None:
        """The calibration of the rectified pair; None where nothing gives the scale."""
        if self.view is None:
            return self.given
        c = self.view.left
        return Calibration(c.fx, c.fy, c.cx, c.cy, self.view.baseline, self.view.shift, (c.width, c.height))


def fitting(cameras: PosedPair, left: RawImage, right: RawImage) -> PosedPair:
    """Return a calibration with the sizes of its images.

    Args:
        cameras: The calibration.
        left, right: The images.

    Raises:
        ValueError: The calibration is for images of another size. One line that names the image.
    """

    def sized(camera: PosedCamera, image: RawImage) -> PosedCamera:
        if camera.size is not None and camera.size != image.size:
            expected, actual = (f"{size[0]} x {size[1]}" for size in (camera.size, image.size))
            raise ValueError(f"{image.path}: is {actual} px, the calibration is for images of {expected}")
        return replace(camera, size=image.size)

    return PosedPair(sized(cameras.left, left), sized(cameras.right, right))


def rectify_pair(
    left: RawImage, right: RawImage, cameras: PosedPair | None = None, focal: float | None = None,
    size: tuple[int, int] | None = None, shift: float | None = None, align: bool = False,
) -> RectifiedPair:  # fmt: skip
    """Rectify a pair.

    With a calibration, both images are resampled to one orientation, and a constant row offset that matches show is
    taken out of the right one. With `align`, six terms are; without a calibration, that is all that is done.

    Args:
        left, right: The raw images.
        cameras: The calibration, with sizes (see `fitting`); None takes the images as they are.
        focal: Focal length of the rectified images [px]; None chooses one, or does not know that of images without a
            calibration, so that a turn of the cameras up or down leaves errors of the columns towards the corners.
        size: Width and height of the rectified images [px]; None takes the left image's.
        shift: Common offset of the disparities to take out [px]; None chooses one where the cameras are turned towards
            each other, so that all disparities of matches are positive, and else 0.
        align: Fit the rows to matches with six terms.

    Returns:
        The pair, of the size asked for, or of the left raw image.

    Raises:
        ValueError: The cameras of the calibration do not stand side by side, or without a calibration the images have
            different sizes.
    """
    view = None if cameras is None else _first_view(cameras, focal, size, shift)
    if view is None and left.size != right.size:
        sizes = (f"{image.path} is {image.size[0]} x {image.size[1]}" for image in (left, right))
        raise ValueError(f"{', '.join(sizes)}: without a calibration both images must have one size")
    given = left.size if view is None else (view.left.width, view.left.height)
    reduction = 1.0 if view is None or cameras is None else max(1.0, cameras.left.lens.focal() / view.left.fx)

    def source(eye: str, target: RectifiedView | None) -> Source:
        if target is None or cameras is None:
            return unchanged
        return rectifying(getattr(cameras, eye), getattr(target, eye), target.rotation)

    focal_length = view.left.fx if view is not None else focal or math.inf
    left_source = source("left", view)
    first = resample(left.pixels, left.valid, left_source, given, reduction)
    removed: RowCorrection | None = None
    right_source = source("right", view)
    second = resample(right.pixels, right.valid, right_source, given, reduction)
    matches = None
    for turn in range(ROUNDS + 1 if align else 2):
        fitted = _fitted(first, second, given, cameras is not None, 6 if align else 1, focal_length)
        if fitted is None:
            matches = None
            break
        correction, (a, b) = fitted
        matches = Matches(
            a, b, left_source(a), right_source(b), row_errors(left_source(a), right_source(b)), row_errors(a, b)
        )
        last = turn == (ROUNDS if align else 1)
        better = None
        if turn == 0 and view is not None and shift is None and view.shift != 0:
            better = view.with_shift(_least_shift(view, matches.disparity))
        if last or not (correction.significant or better is not None):
            break
        if better is not None and view is not None:
            moved = better.shift - view.shift
            view = better
            base = right_source
            right_source = _shifted(base, moved)
            correction = replace(correction, middle=(correction.middle[0] + moved, correction.middle[1]))
        if correction.significant:
            right_source = correction.applied(right_source)
            removed = correction if removed is None else _sum(removed, correction)
        second = resample(right.pixels, right.valid, right_source, given, reduction)
    return RectifiedPair(first[0], second[0], first[1], second[1], view, matches, removed, cameras)


def _first_view(
    cameras: PosedPair, focal: float | None, size: tuple[int, int] | None, shift: float | None
) -> RectifiedView:
    """Return the view before any match is known, with the contents of both images in the middle."""
    together = rectified_view(cameras, focal, size)
    if shift == 0:
        return together
    apart = rectified_view(cameras, focal, size, apart=True)
    if shift is not None:
        return apart.with_shift(shift)
    return apart.with_shift(float(round(apart.shift))) if abs(apart.shift) > APART * apart.left.width else together


def _least_shift(view: RectifiedView, disparity: np.ndarray) -> float:
    """Return the largest shift, in whole pixels, that leaves the disparities of matches positive, with a margin."""
    least = float(np.percentile(disparity, LEAST_PERCENTILE)) - MARGIN * view.left.width
    lowered = view.shift + float(np.floor(min(0.0, least)))
    return max(0.0, lowered) if view.shift > 0 else view.shift


def _fitted(
    first: tuple[np.ndarray, np.ndarray], second: tuple[np.ndarray, np.ndarray], size: tuple[int, int],
    calibrated: bool, terms: int, focal: float,
) -> tuple[RowCorrection, tuple[np.ndarray, np.ndarray]] | None:  # fmt: skip
    """Match two images with their masks and fit the rows; None where too few points match."""
    eyes = [for_matching(*eye) for eye in (first, second)]
    for reach in (REACH, WIDE_REACH) if calibrated else (WIDE_REACH,):
        a, b = matched_points(eyes[0], eyes[1], (first[1], second[1]), max(8.0, reach * size[1]))
        fit = fit_rows(a, b, size, terms, focal)
        if fit is not None:
            correction, right = fit
            right[right] = _alike(a[right], b[right], DISPARITY_STEP * size[0])
            return correction, (a[right], b[right])
    return None


def _alike(left: np.ndarray, right: np.ndarray, step: float) -> np.ndarray:
    """Return which matches (N,) have a disparity like that of their neighbours in the left image, within `step` px."""
    disparity = (left - right)[:, 0]
    _, near = scipy.spatial.cKDTree(left).query(left, k=min(NEIGHBOURS, len(left)))
    return np.abs(disparity - np.median(disparity[near], axis=1)) <= step


def _shifted(source: Source, by: float) -> Source:
    """Return the Source of an image whose content lies `by` px farther right."""
    return lambda pixels: source(pixels - np.array([by, 0.0]))


def _sum(first: RowCorrection, second: RowCorrection) -> RowCorrection:
    """Return about what two corrections, one after the other, take out, for the report."""
    terms = tuple(a + b for a, b in zip(first.terms, second.terms))
    grid = np.arange(-19, 20, 2) / 20  # the middles of 20 equal parts of -1 to 1
    x, y = np.meshgrid(*(grid * half / first.unit for half in first.middle))
    size = np.sqrt(np.mean(sum(c * x**i * y**j for c, (i, j) in zip(terms, POWERS)) ** 2))
    return replace(first, terms=terms, error=second.error, size=float(size))
