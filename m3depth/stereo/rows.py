"""Rows of a stereo pair that lie apart: how far, from the images alone, and a right image without it.

A rig whose calibration has aged shows a point in another row of the right image than of the left one. The cause is
nearly always a small turn of one camera, up or down and about its optical axis, or a difference of focal lengths:

    v_right - v_left = offset (1 + y^2) + f_y rotation x + f_y scale y,    x, y = (u - cx) / fx, (v - cy) / fy

These three are fitted to 30 to 384 points, and taken out by resampling the right image as the turned camera
asks. That moves columns too: a rotation of 0.1 deg about the axis changes the disparities of NaTeCam by 0.4 px in the
upper and lower rows. A turn to the side hardly moves rows, so it cannot be estimated from them, and stays as an error
of all disparities.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from m3depth.stereo.pairs import checked_pair, in_grey
from m3depth.stereo.robust_fit import LEAST_POINTS, LEAST_SHARE, consensus_fit, weighted_fit
from m3depth.stereo.row_matches import SEARCH_WIDTH, band_matches, followed
from marssim.base.camera import PinholeCamera, StereoRig

REACH = 1 / 32  # share of the width by which rows may lie apart
FINE_WIDTH = 1024  # [px] width to which larger images are reduced
MATCH_ERROR = 1.5  # [px of the searched images] of a true match, which is known to a pixel in columns and rows
GRID = 33  # places along each side at which the rows' distance is averaged over the image
TURN_ERRORS, SCALE_ERRORS = 3.0, 8.0  # standard errors from which a fit, and its scale, are significant
MATTERS = 0.1  # [px] below which M3Depth gains 2 % at most, measured


@dataclass(frozen=True)
class RowFit:
    """How the right image of a pair lies to the rows of the left one.

    Attributes:
        offset: How far the right image lies too low, at the principal point [px].
        rotation: Rotation of the right image about the principal point [rad], positive is clockwise.
        scale: Magnification of the right image, less 1.
        size: Distance of the rows, root mean square over the image [px].
        largest: Largest distance of the rows in the image [px].
        error: Standard error of the fit, root mean square over the image [px].
        points: Number of points that the fit is from.
    """

    offset: float
    rotation: float
    scale: float
    size: float
    largest: float
    error: float
    points: int

    @property
    def significant(self) -> bool:
        """Whether to take it out: it is larger than its error, and large enough to matter."""
        return self.size > max(MATTERS, TURN_ERRORS * self.error)

    def to_dict(self) -> dict[str, float]:
        """Return the fit as results record it: distances in px, the rotation in degrees."""
        return {
            "offset_px": round(self.offset, 4), "rotation_deg": round(float(np.rad2deg(self.rotation)), 5),
            "scale": round(1 + self.scale, 6), "rms_px": round(self.size, 4), "error_px": round(self.error, 4),
        }  # fmt: skip

    def __str__(self) -> str:
        turn = f"offset {self.offset:+.2f} px, rotation {np.rad2deg(self.rotation):+.3f} deg"
        scale = f", scale {1 + self.scale:.4f}" if self.scale else ""
        return f"{self.size:.2f} +- {self.error:.2f} px ({turn}{scale})"


def row_misalignment(left: np.ndarray, right: np.ndarray, rig: StereoRig, reach: float | None = None) -> RowFit | None:
    """Estimate how far the rows of a pair lie apart, from the pair alone.

    Args:
        left: (H, W) or (H, W, 3) uint8 left image.
        right: The right image, likewise.
        rig: The cameras of these images.
        reach: Largest distance of rows that is searched [px]; None is a 32nd of the width.

    Returns:
        The fit; None where too few points match, as on smooth dust, in blank images and in images of two places.

    Raises:
        ValueError: Images of a wrong type or size, or a reach that is not positive.
    """
    if reach is not None and not (np.isfinite(reach) and reach > 0):
        raise ValueError(f"reach must be positive, got {reach}")
    first, second = map(in_grey, checked_pair(left, right, rig))
    reduction = max(1.0, rig.camera.width / FINE_WIDTH)
    fine = rig
    if reduction > 1:
        size = (FINE_WIDTH, max(1, round(rig.camera.height / reduction)))
        fine = rig.resized(*size)
        first, second = (np.asarray(cv2.resize(x, size, interpolation=cv2.INTER_AREA)) for x in (first, second))
    start, end = band_matches(first, second, fine, (reach or REACH * rig.camera.width) / reduction)
    if len(start) < LEAST_POINTS:
        return None
    camera = fine.camera
    tolerance = max(1.0, camera.width / SEARCH_WIDTH)  # [px] a pixel of the images that were searched
    consensus = consensus_fit(_terms(camera, end), (end - start)[:, 1], MATCH_ERROR * tolerance)
    if consensus is None:
        return None
    rough, agree = consensus
    turn = _homography(camera, *rough)
    start, end = start[agree], _moved(end[agree], np.linalg.inv(turn))
    straight = _resampled(second, turn, cv2.INTER_LINEAR)  # as exact here as Lanczos, and four times as fast
    end, sure = followed(first, straight, start, np.column_stack([end[:, 0], start[:, 1]]))
    if sure.sum() < max(LEAST_POINTS, LEAST_SHARE * len(sure)):
        return None
    terms = _terms(camera, end[sure])
    distance = (end - start)[sure, 1] + terms @ rough
    fit, covariance = weighted_fit(terms, distance)
    if abs(fit[2]) < SCALE_ERRORS * np.sqrt(covariance[2, 2]):
        fit, covariance = np.zeros(3), np.zeros((3, 3))
        fit[:2], covariance[:2, :2] = weighted_fit(terms[:, :2], distance)
    everywhere = _terms(camera, _grid(camera))
    rows = everywhere @ fit
    return RowFit(
        offset=float(fit[0] * reduction),
        rotation=float(fit[1]),
        scale=float(fit[2]),
        size=float(np.sqrt((rows**2).mean()) * reduction),
        largest=float(np.abs(rows).max() * reduction),
        error=float(np.sqrt(((everywhere @ covariance) * everywhere).sum(axis=1).mean()) * reduction),
        points=int(sure.sum()),
    )


def aligned_right(right: np.ndarray, rig: StereoRig, fit: RowFit) -> np.ndarray:
    """Return the right image as an ideal camera would have taken it, by Lanczos; its border is repeated.

    Args:
        right: (H, W) or (H, W, 3) uint8 right image.
        rig: The cameras of the pair.
        fit: Its row_misalignment.

    Returns:
        An image of the same shape. Its disparities are those of the rig.
    """
    return _resampled(right, _homography(rig.camera, fit.offset, fit.rotation, fit.scale))


def align_rows(left: np.ndarray, right: np.ndarray, rig: StereoRig) -> tuple[np.ndarray, RowFit | None]:
    """Take out the rows' misalignment where it is significant.

    Args:
        left: (H, W) or (H, W, 3) uint8 left image.
        right: The right image, likewise.
        rig: The cameras of these images.

    Returns:
        The right image to match with, and the fit that was taken out. Without a significant one, the given image
        itself, and None.

    Raises:
        ValueError: Images of a wrong type or size.
    """
    fit = row_misalignment(left, right, rig)
    if fit is None or not fit.significant:
        return right, None
    return aligned_right(right, rig, fit), fit


def columns_in_given_image(columns: np.ndarray, rig: StereoRig, fit: RowFit) -> np.ndarray:
    """Return the columns of the given right image that pixels of the aligned one were taken from.

    Args:
        columns: (H, W) float columns in the aligned right image [px], in the rows of the pixel.
        rig: The cameras of the pair.
        fit: What was taken out.
    """
    height, width = columns.shape
    rows = np.broadcast_to(np.arange(height, dtype=float)[:, None], (height, width))
    places = np.stack([columns, rows], axis=-1).reshape(-1, 2)
    return _moved(places, _homography(rig.camera, fit.offset, fit.rotation, fit.scale))[:, 0].reshape(height, width)


def _homography(camera: PinholeCamera, offset: float, rotation: float, scale: float) -> np.ndarray:
    """Return the (3, 3) map of pixels of the ideal right image to those of the given one."""
    turn, _ = cv2.Rodrigues(np.array([-offset / camera.fy, 0.0, rotation]))
    larger = np.diag([1 + scale, 1 + scale, 1.0])
    return camera.K @ larger @ turn @ np.linalg.inv(camera.K)


def _moved(places: np.ndarray, homography: np.ndarray) -> np.ndarray:
    """Return places (N, 2) [px] after a (3, 3) homography."""
    x, y, z = homography @ np.column_stack([places, np.ones(len(places))]).T
    return np.column_stack([x / z, y / z])


def _resampled(image: np.ndarray, homography: np.ndarray, interpolation: int = cv2.INTER_LANCZOS4) -> np.ndarray:
    """Return the image that shows at each pixel what `image` shows where the homography takes it."""
    # OpenCV's cubic interpolation moves what it shows by up to 0.05 px: a = -0.75 does not keep a ramp.
    return cv2.warpPerspective(
        image, homography, image.shape[1::-1], flags=interpolation | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )  # fmt: skip


def _terms(camera: PinholeCamera, places: np.ndarray) -> np.ndarray:
    """Return (N, 3) what offset, rotation and scale of 1 move rows by [px], at places (N, 2) of the right image."""
    x, y = (places[:, 0] - camera.cx) / camera.fx, (places[:, 1] - camera.cy) / camera.fy
    return np.column_stack([1 + y * y, camera.fy * x, camera.fy * y])


def _grid(camera: PinholeCamera) -> np.ndarray:
    """Return (N, 2) places that are spread evenly over the image, to its corners [px]."""
    u, v = np.meshgrid(np.linspace(0, camera.width - 1, GRID), np.linspace(0, camera.height - 1, GRID))
    return np.column_stack([u.ravel(), v.ravel()])
