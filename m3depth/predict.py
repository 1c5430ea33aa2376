"""Depth, normals and a point cloud of one rectified stereo pair.

    python -m m3depth.predict left.png right.png --focal 595.9 --baseline 0.27 --out RESULT
    python -m m3depth.predict image_2/000000_10.png image_3/000000_10.png --calib calib.txt --out RESULT

The images must be rectified: what the left eye sees at a pixel, the right eye sees in the same row, farther left.
A calibration file (KITTI, Middlebury, ETH3D, OpenCV's stereoRectify, a dataset's sample.json) gives the focal lengths,
the principal point and the baseline; flags given beside it replace what it says. Writes into RESULT:

    depth.npy          float32 [m]; inf: sky or beyond measure, NaN: unknown
    depth.png          uint16 [mm]; 0: none, or farther than 65.5 m
    disparity.npy      float32 [px], f B / depth: with a calibration whose eyes have different principal points (doffs),
                       that difference is in it;  disparity.png: uint16, times 256
    normal.npy         float32, camera frame (x right, y down, z forward);  normal.png: red right, green up, blue to
                       the camera, black: unknown
    confidence.npy     float32, 0 to 1
    cloud.ply          coloured points [m], camera frame, without what hangs between two surfaces
    figure.png         all of it at a glance
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import tyro

from m3depth.calibration import Calibration, align_right, read_calibration
from m3depth.estimator import Estimator, load_estimator
from m3depth.figures.prediction import prediction_figure
from m3depth.image_files import read_pair
from m3depth.pair_checks import eyes_swapped
from m3depth.prediction import Prediction
from marssim.camera import StereoRig
from marssim.command import counted, run_command
from marssim.contact_sheet import normal_colours
from marssim.depth_edges import depth_edges
from marssim.pointcloud import coloured_points, encode_ply

MIN_ANGLE, MAX_ANGLE = 1.0, 150.0  # [deg] horizontal field of view of rectified images
MIN_BASELINE, MAX_BASELINE = 0.001, 50.0  # [m]
EDGE_SHARE = 0.02  # of the disparity, that it may change by within 3 x 3 px: near surfaces may be steep


@dataclass(frozen=True)
class PredictOptions:
    """Depth, normals and a point cloud of one rectified stereo pair."""

    left: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="LEFT")]
    """Left image, grey or colour, 8 or 16 bit."""
    right: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="RIGHT")]
    """Right image, of the same size."""
    out: Path
    """Folder for the results."""
    focal: float | None = None
    """Focal length of the rectified images [px]."""
    baseline: float | None = None
    """Distance of the two cameras [m]."""
    calib: Path | None = None
    """Calibration file instead of --focal and --baseline."""
    cx: float | None = None
    """Principal point, column of the left image [px] from 0; default: the calibration's, or the middle."""
    cy: float | None = None
    """Principal point, row [px] from 0; default: the calibration's, or the middle."""
    weights: Path | None = None
    """A .safetensors file written by m3depth.train; default: the weights that come with the package."""
    method: str = "m3depth"
    """m3depth, sgbm, sad, ssd, ncc, or package.module:Class (a class with infer(left, right, rig))."""
    min_confidence: float = 0.5
    """Pixels of less confidence, 0 to 1, are left out of the point cloud."""
    max_range: float = 30.0
    """Points farther ahead [m] are left out of the point cloud."""


def make_calibration(options: PredictOptions, height: int, width: int) -> Calibration:
    """What the options and the calibration file say of a pair of this size.

    Raises FileNotFoundError or ValueError that names the flag or the file.
    """
    for flag, value in (("--focal", options.focal), ("--baseline", options.baseline)):
        if value is None and options.calib is None:
            raise ValueError(f"{flag} is missing; or give a calibration file with --calib")
        if value is not None and not (np.isfinite(value) and value > 0):
            raise ValueError(f"{flag} must be positive, got {value}")
    for flag, value in (("--cx", options.cx), ("--cy", options.cy)):
        if value is not None and not np.isfinite(value):
            raise ValueError(f"{flag} must be finite, got {value}")
    if options.calib is None:
        assert options.focal is not None and options.baseline is not None
        middle = ((width - 1) / 2, (height - 1) / 2)
        found = Calibration(options.focal, options.focal, *middle, options.baseline)
    else:
        found = read_calibration(options.calib, options.left)
    calibration = replace(
        found,
        fx=found.fx if options.focal is None else options.focal,
        fy=found.fy if options.focal is None else options.focal,
        cx=found.cx if options.cx is None else options.cx,
        cy=found.cy if options.cy is None else options.cy,
        baseline=found.baseline if options.baseline is None else options.baseline,
    )
    if calibration.size is not None and calibration.size != (width, height):
        meant = f"{calibration.size[0]} x {calibration.size[1]}"
        raise ValueError(f"{options.calib}: is for images of {meant} px, {options.left} is {width} x {height}")
    _check_sense(calibration, width, options)
    return calibration


def _check_sense(calibration: Calibration, width: int, options: PredictOptions) -> None:
    """Raise ValueError for a focal length or a baseline that is most likely of another unit."""
    focal_from = "--focal" if options.calib is None or options.focal else f"{options.calib}: focal length"
    baseline_from = "--baseline" if options.calib is None or options.baseline else f"{options.calib}: baseline"
    angle = np.rad2deg(2 * np.arctan2(width / 2, calibration.fx))
    if not MIN_ANGLE <= angle <= MAX_ANGLE:
        raise ValueError(
            f"{focal_from} {calibration.fx:g} px makes images of {width} px {angle:.3g} deg wide; "
            "it is counted in pixels of these images"
        )
    if not MIN_BASELINE <= calibration.baseline <= MAX_BASELINE:
        raise ValueError(
            f"{baseline_from} {calibration.baseline:g} m is out of [{MIN_BASELINE:g}, {MAX_BASELINE:g}] m; "
            "give --baseline in metres"
        )


def point_cloud(
    left: np.ndarray, prediction: Prediction, rig: StereoRig, min_confidence: float = 0.5, max_range: float = 30.0
) -> tuple[np.ndarray, np.ndarray]:
    """Points that can be trusted, and their colours.

    left: (H, W) or (H, W, 3) uint8. Left out are unknown depth, depth over max_range [m], confidence under
    min_confidence, and depth edges. Returns (N, 3) float32 [m] in the left camera's frame and (N, 3) uint8 RGB.
    """
    with np.errstate(invalid="ignore"):
        keep = prediction.confidence >= min_confidence
    keep &= ~depth_edges(prediction.disparity, share=EDGE_SHARE)
    colour = left if left.ndim == 3 else np.repeat(left[..., None], 3, axis=2)
    return coloured_points(colour, np.where(keep, prediction.depth, np.nan), rig.camera, max_range)


def write_prediction(
    out: Path, left: np.ndarray, prediction: Prediction, rig: StereoRig, min_confidence: float, max_range: float
) -> int:
    """Write every file that the module's docstring lists; returns the number of points of the cloud. Raises OSError."""
    out.mkdir(parents=True, exist_ok=True)
    for name in ("depth", "disparity", "normal", "confidence"):
        array = getattr(prediction, name)
        if array is not None:
            np.save(out / f"{name}.npy", array)
    _write_png(out / "depth.png", _uint16(prediction.depth * 1000.0))
    _write_png(out / "disparity.png", _uint16(prediction.disparity * 256.0))
    if prediction.normal is not None:
        _write_png(out / "normal.png", np.ascontiguousarray(normal_colours(prediction.normal)[..., ::-1]))
    points, colour = point_cloud(left, prediction, rig, min_confidence, max_range)
    (out / "cloud.ply").write_bytes(encode_ply(points, colour))
    prediction_figure(left, prediction, out / "figure.png")
    return len(points)


def _uint16(values: np.ndarray) -> np.ndarray:
    """Rounded; 0 where the value is not finite or does not fit."""
    fits = np.isfinite(values) & (values >= 0) & (values < 65535.5)
    return np.round(np.where(fits, values, 0)).astype(np.uint16)


def _write_png(path: Path, image: np.ndarray) -> None:
    if not cv2.imwrite(str(path), image):
        raise OSError(f"{path}: could not be written")


def predict(options: PredictOptions, estimator: Estimator | None = None) -> Prediction:
    """Read the pair, estimate, write the files, say in one line what came out.

    estimator: instead of the one that the options name. Raises FileNotFoundError or ValueError with one line for the
    user. An image without any contrast, and eyes that seem exchanged, are reported on stderr; the result is then a
    guess.
    """
    left, right = read_pair(options.left, options.right)
    calibration = make_calibration(options, *left.shape[:2])
    rig = calibration.rig(left.shape[1], left.shape[0])
    if options.out.exists() and not options.out.is_dir():
        raise ValueError(f"--out {options.out}: is not a folder")
    if options.weights is not None and options.method != "m3depth":
        raise ValueError(f"--weights belongs to m3depth, not to --method {options.method}")
    for path, image in ((options.left, left), (options.right, right)):
        if image.min() == image.max():
            tone = "black" if image.max() == 0 else "of one grey level"
            print(f"warning: {path} is {tone}: there is nothing to match", file=sys.stderr)
    right = align_right(right, calibration.shift)
    if eyes_swapped(left, right, rig):
        print("warning: the images match the wrong way round: are left and right exchanged?", file=sys.stderr)
    if estimator is None:
        spec = options.method if options.weights is None else f"m3depth:{options.weights}"
        estimator = load_estimator(spec, "--method")
    prediction = estimator.infer(left, right, rig)
    count = write_prediction(options.out, left, prediction, rig, options.min_confidence, options.max_range)
    known = prediction.depth[np.isfinite(prediction.depth)]
    seen = "no depth"
    if len(known):
        low, middle, high = np.percentile(known, [5, 50, 95])
        seen = f"depth {low:.2f} to {high:.2f} m (5 to 95 %), median {middle:.2f} m"
    share = 100 * len(known) / prediction.depth.size
    print(f"{options.out}: {seen} on {share:.0f} % of the pixels; {counted(count, 'point')}")
    return prediction


def main(args: Sequence[str] | None = None) -> int:
    """The command. Returns the exit code: 2 for a mistake in what was asked for."""
    return run_command(
        predict, PredictOptions, "python -m m3depth.predict", __doc__, args, "the results may be incomplete"
    )


if __name__ == "__main__":
    sys.exit(main())
