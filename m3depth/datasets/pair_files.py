"""One stereo pair of a dataset: its files, and the sample read from them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from m3depth.datasets.config import DataConfig
from m3depth.datasets.image_files import read_pair
from m3depth.datasets.maps import Kind, read_map, read_mask
from m3depth.datasets.normal_maps import check_frame, read_normals
from m3depth.stereo.pairs import in_colour
from m3depth.stereo.plane_normals import fitted_normals
from marssim.base.calibration.rectified import Calibration, align_right
from marssim.base.camera import StereoRig
from marssim.base.dataset.sample import StereoSample
from marssim.base.files.json_file import DatasetError
from marssim.base.images.depth_edges import depth_edges

CalibrationReader = Callable[[int, int], Calibration]
"""Returns the calibration of images of (width, height) [px]."""
CalibrationFinder = Callable[[Path, Path], CalibrationReader]
"""Returns the CalibrationReader of a pair, from the path of its calibration file and of its left image."""

FITTED = 7  # window in which normals are fitted to depth [px], as wide as Normal-Assisted Stereo's
LARGEST_SHIFT = 0.5  # of the width, by which a calibration's `shift` may move the right image
SHIFT_KEY = "disparity_shift_px"  # in `meta` of a sample
BREAK = 0.1  # share of the disparity by which one surface may change within 3 x 3 px


def is_above_zero(mask: np.ndarray) -> np.ndarray:
    """Return the pixels of a mask that are hidden where it marks the hidden ones."""
    return mask > 0


def is_zero(mask: np.ndarray) -> np.ndarray:
    """Return the pixels of a mask that are hidden where it marks the visible ones."""
    return mask == 0


@dataclass(frozen=True)
class PairFiles:
    """The files of one pair, and how they are read.

    Attributes:
        name: Name in reports.
        group: Scene of the pair; a split never divides one.
        left, right: The images.
        truth: The map of the left image.
        kind: What the map holds, "disparity" or "depth".
        calibration: Reads the calibration, given width and height of the left image.
        zero_is_far: A disparity of 0 is sky, not a gap.
        unit: See read_map.
        visible: A mask of visible pixels.
        hidden: Tells occluded pixels from the mask; only pixels of known depth count. A function of a module, so that
            a pair can go to another process.
        normal: The map of normals of the left image.
    """

    name: str
    group: str
    left: Path
    right: Path
    truth: Path
    kind: Kind
    calibration: CalibrationReader
    zero_is_far: bool = False
    unit: float | None = None
    visible: Path | None = None
    hidden: Callable[[np.ndarray], np.ndarray] | None = None
    normal: Path | None = None


def read_pair_files(files: PairFiles, config: DataConfig) -> StereoSample:
    """Read the pair as a sample.

    Unknown depth is NaN, with disparity 0; unknown normals are 0; there are no rocks. Sky has infinite depth, where the
    format marks it. The right image is moved where the cameras have different principal points (Middlebury's doffs);
    the disparity then contains that difference, which `meta` holds as SHIFT_KEY, in pixels of the sample.

    Args:
        files: The files of the pair.
        config: Normals, resizing and scored depths.

    Raises:
        DatasetError: A file is missing, broken, or of another size than its partners; the message, one line, names it.
    """
    for path in (files.left, files.right):
        if not path.is_file():
            raise DatasetError(f"{path}: no such file")
    try:
        left, right = map(in_colour, read_pair(files.left, files.right))
    except ValueError as error:
        raise DatasetError(str(error)) from None
    height, width = left.shape[:2]
    calibration = files.calibration(width, height)
    if abs(calibration.shift) > LARGEST_SHIFT * width:  # the right image would be moved out of view
        raise DatasetError(
            f"{files.left}: its calibration takes {calibration.shift:g} px out of all disparities, and pairs with true "
            "depth cannot be read so; rectify them with m3depth.rectify --shift 0"
        )
    try:
        rig = calibration.rig(width, height)
    except ValueError as error:
        raise DatasetError(f"{files.left}: {error}") from None
    values = _fitting(files.truth, read_map(files.truth, files.kind, files.unit, files.zero_is_far), left)
    if files.kind == "depth":
        if config.depth_along == "ray":
            values = (values / np.linalg.norm(rig.camera.rays(), axis=-1)).astype(np.float32)
        depth, disparity = values, rig.depth_to_disparity(values)
    else:
        with np.errstate(invalid="ignore"):  # sky stays 0
            matched = values > 0
            disparity = np.where(matched, values + np.float32(calibration.shift), values)
            disparity = np.where(matched & (disparity <= 0), np.float32(np.nan), disparity)  # beyond infinity
        depth, values = rig.disparity_to_depth(disparity), disparity
    depth = np.where(np.isnan(values), np.float32(np.nan), depth)
    occluded = np.zeros(depth.shape, bool)
    if files.visible is not None and files.hidden is not None:
        mask = _fitting(files.visible, read_mask_or_map(files.visible), left)
        occluded = files.hidden(mask) & np.isfinite(depth)
    begins = max(0.0, -calibration.shift)  # the first column that the right image shows after the next line
    with np.errstate(invalid="ignore"):
        occluded |= np.isfinite(depth) & (np.arange(width) - disparity < begins - 0.5)
    right = align_right(right, calibration.shift)
    normal = np.zeros((*depth.shape, 3), np.float32)
    if files.normal is not None:
        disparity = rig.depth_to_disparity(depth)
        normal = _fitting(files.normal, read_normals(files.normal, config.normal_frame), left)
        check_frame(files.normal, normal, config.normal_frame, rig.camera, unbroken_normals(disparity, rig))
    if config.resize < 1:
        left, right, depth, occluded, normal, rig = _reduced(left, right, depth, occluded, normal, rig, config.resize)
    disparity = rig.depth_to_disparity(depth)  # 0 where unknown
    if config.normals == "depth":
        normal = unbroken_normals(disparity, rig)
    low, high = config.depth_range
    with np.errstate(invalid="ignore"):
        valid = np.isfinite(depth) & (depth >= low) & (depth <= high)
    return StereoSample(
        left, right, depth, disparity, normal, valid, occluded, np.zeros(depth.shape, np.int32), rig,
        {
            "files": {"left": str(files.left), "right": str(files.right), "truth": str(files.truth)},
            SHIFT_KEY: calibration.shift * rig.camera.width / width,
        },
    )  # fmt: skip


def read_mask_or_map(path: Path) -> np.ndarray:
    """Read a mask, or KITTI's disparity of the pixels that both cameras see as a mask: (H, W) uint8."""
    if path.parent.name.startswith("disp_noc"):
        return np.isfinite(read_map(path, "disparity")).astype(np.uint8)
    return read_mask(path)


def unbroken_normals(disparity: np.ndarray, rig: StereoRig) -> np.ndarray:
    """Fit planes to the disparity; the normal is 0 where a window of 7 x 7 px has gaps or spans a depth edge.

    Args:
        disparity: (H, W) [px], 0 where unknown.
        rig: The cameras of the map.

    Returns:
        (H, W, 3) float32.
    """
    broken = (disparity <= 0) | depth_edges(disparity, share=BREAK)
    near_break = cv2.dilate(broken.astype(np.uint8), np.ones((FITTED, FITTED), np.uint8)) > 0
    rim = FITTED // 2
    near_break[:rim] = near_break[-rim:] = True
    near_break[:, :rim] = near_break[:, -rim:] = True
    normal = fitted_normals(disparity, rig.camera, FITTED)
    return np.where(near_break[..., None], np.float32(0), normal)


def _fitting(path: Path, values: np.ndarray, image: np.ndarray) -> np.ndarray:
    """Return the values if they have the image's size. Raises DatasetError that names the file otherwise."""
    if values.shape[:2] != image.shape[:2]:
        raise DatasetError(
            f"{path}: is {values.shape[1]} x {values.shape[0]}, its image is {image.shape[1]} x {image.shape[0]}"
        )
    return values


def _reduced(
    left: np.ndarray, right: np.ndarray, depth: np.ndarray, occluded: np.ndarray, normal: np.ndarray, rig: StereoRig,
    factor: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, StereoRig]:  # fmt: skip
    """Reduce a pair.

    Disparity is interpolated on surfaces, at the same places as the images. Beside edges and unknown pixels, depth is
    that of the nearest pixel, as normals are everywhere: never a mean over an edge.
    """
    size = max(1, round(left.shape[1] * factor)), max(1, round(left.shape[0] * factor))
    small = rig.resized(*size)

    def nearest(values: np.ndarray) -> np.ndarray:
        return cv2.resize(values, size, interpolation=cv2.INTER_NEAREST_EXACT)

    disparity = rig.depth_to_disparity(depth)
    broken = (disparity <= 0) | depth_edges(disparity, share=BREAK)
    surface = cv2.dilate(broken.astype(np.uint8), np.ones((3, 3), np.uint8)) == 0
    between = cv2.resize(disparity, size, interpolation=cv2.INTER_LINEAR) * np.float32(size[0] / left.shape[1])
    depth = np.where(nearest(surface.astype(np.uint8)) > 0, small.disparity_to_depth(between), nearest(depth))
    left, right = (cv2.resize(eye, size, interpolation=cv2.INTER_AREA) for eye in (left, right))
    return left, right, depth.astype(np.float32), nearest(occluded.astype(np.uint8)) > 0, nearest(normal), small
