"""How far the rows of matched points lie apart, and the correction of the right image that takes it out.

The distance v_right - v_left is fitted by up to six terms of the place in the right image, with s half of the larger
side and x, y counted from the middle in units of s:

    c0 + c1 x + c2 y + c3 x^2 + c4 x y + c5 y^2

c0 is a constant offset, as of a turn up or down, c1 a rotation about the optical axis, c2 a magnification, and the rest
what turns, also to the side, and another distortion leave. The rotation and the magnification move columns too, and so
does the turn up or down, by c0 X Y with X and Y the tangents of the direction: that needs the focal length.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from m3depth.stereo.robust_fit import LEAST_POINTS, MAD_TO_DEVIATION, consensus_fit, weighted_fit
from marssim.base.images.resampling import Source

TOLERANCE = 3.0  # [px] by which the rows of right matches may miss three terms
WRONG = 4.0  # deviations beyond which a match is wrong, and never under LEAST_WRONG
LEAST_WRONG = 0.5  # [px]
ERRORS = 3.0  # standard errors from which a correction is no accident
MATTERS = 0.02  # [px] root mean square below which a correction changes nothing
WRONG_ROWS = 2.5  # [px] distance of the rows from which on a pair is not rectified; see row_limit
FULL_WIDTH = 1024  # [px] width of images from which on such limits grow with the width
POWERS = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))  # of x and y


@dataclass(frozen=True)
class RowCorrection:
    """What is taken out of the rows of a right image.

    Attributes:
        terms: c0 to c5 [px]; the last ones are 0 where fewer were fitted.
        error: Standard error, root mean square over the points [px].
        size: The correction itself, root mean square [px]: over the points where it was fitted, over the whole image
            for the sum of two.
        middle: (2,) middle of the image [px].
        unit: s [px].
        focal: Focal length [px]; infinite where it is not known, so that a turn up or down moves no columns.
    """

    terms: tuple[float, ...]
    error: float
    size: float
    middle: tuple[float, float]
    unit: float
    focal: float = math.inf

    @property
    def significant(self) -> bool:
        """Whether to take it out."""
        return self.size > max(MATTERS, ERRORS * self.error)

    def moved(self, pixels: np.ndarray) -> np.ndarray:
        """Return where the given image shows what the corrected one shows at pixels (..., 2)."""
        x, y = ((pixels[..., i] - self.middle[i]) / self.unit for i in (0, 1))
        down = sum(c * x**i * y**j for c, (i, j) in zip(self.terms, POWERS))
        across = self.terms[2] * x - self.terms[1] * y + self.terms[0] * x * y * (self.unit / self.focal) ** 2
        return np.stack([pixels[..., 0] + across, pixels[..., 1] + down], axis=-1)

    def applied(self, source: Source) -> Source:
        """Return the Source of the corrected image, from that of the given one."""
        return lambda pixels: source(self.moved(pixels))

    def __str__(self) -> str:
        if not any(self.terms[1:]):
            return f"{self.terms[0]:+.2f} +- {self.error:.2f} px"
        return f"{self.size:.2f} +- {self.error:.2f} px (offset {self.terms[0]:+.2f} px, six terms)"


@dataclass(frozen=True)
class RowErrors:
    """Distances of the rows of matched points.

    Attributes:
        points: Number of points.
        median: Median of the absolute distance [px].
        most: 95th percentile of the absolute distance [px].
        offset: Median of v_right - v_left [px].
    """

    points: int
    median: float
    most: float
    offset: float

    def as_dict(self) -> dict[str, float]:
        """Return the values for a report, by their names and units."""
        return {
            "points": self.points, "median_px": round(self.median, 4), "percentile_95_px": round(self.most, 4),
            "offset_px": round(self.offset, 4),
        }  # fmt: skip


def row_limit(limit: float, width: int) -> float:
    """Return a limit on the distance of rows [px] for images of a width [px]."""
    return limit * max(1.0, width / FULL_WIDTH)


def row_errors(left: np.ndarray, right: np.ndarray) -> RowErrors:
    """Return the distances of the rows of points (N, 2) in both images."""
    distance = right[:, 1] - left[:, 1]
    absolute = np.abs(distance)
    return RowErrors(
        len(distance), float(np.median(absolute)), float(np.percentile(absolute, 95)), float(np.median(distance))
    )


def fit_rows(
    left: np.ndarray, right: np.ndarray, size: tuple[int, int], terms: int, focal: float = math.inf
) -> tuple[RowCorrection, np.ndarray] | None:
    """Fit the distances of rows, and tell wrong matches from right ones.

    Args:
        left: (N, 2) places in the left image [px].
        right: (N, 2) places of the same points in the right image [px].
        size: Width and height of the right image [px].
        terms: How many terms the correction has, 1 or 6.
        focal: Focal length of the images [px]; infinite if it is not known.

    Returns:
        The correction and which matches are right, (N,) bool; None where too few agree.
    """
    if len(left) < LEAST_POINTS:
        return None
    middle, unit = ((size[0] - 1) / 2, (size[1] - 1) / 2), max(size) / 2
    x, y = ((right[:, i] - middle[i]) / unit for i in (0, 1))
    columns = np.stack([x**i * y**j for i, j in POWERS], axis=1)
    distance = right[:, 1] - left[:, 1]
    consensus = consensus_fit(columns[:, :3], distance, TOLERANCE)
    if consensus is None:
        return None
    agree = consensus[1]
    for count in (3, 6, 6) if agree.sum() >= 2 * LEAST_POINTS else (3, 3):
        fit, _ = weighted_fit(columns[agree, :count], distance[agree])
        rest = np.abs(distance - columns[:, :count] @ fit)
        agree = rest <= max(LEAST_WRONG, WRONG * MAD_TO_DEVIATION * float(np.median(rest[agree])))
        if agree.sum() < LEAST_POINTS:
            return None
    terms = terms if agree.sum() >= 2 * LEAST_POINTS else min(terms, 3)
    fit, covariance = weighted_fit(columns[agree, :terms], distance[agree])
    agreeing = columns[agree, :terms]
    error = float(np.sqrt(np.einsum("ni,ij,nj->n", agreeing, covariance, agreeing).mean()))
    values = np.zeros(len(POWERS))
    values[:terms] = fit
    size_ = float(np.sqrt(((agreeing @ fit) ** 2).mean()))
    return RowCorrection(tuple(float(v) for v in values), error, size_, middle, unit, focal), agree
