"""Predict depth, normals and a point cloud of one rectified stereo pair.

    python -m m3depth.predict left.png right.png --focal 595.9 --baseline 0.27 --out RESULT
    python -m m3depth.predict image_2/000000_10.png image_3/000000_10.png --calib calib.txt --out RESULT
    python -m m3depth.predict left.png right.png --calib left.yaml right.yaml --out RESULT      # ROS CameraInfo

The images must be rectified: what the left eye sees at a pixel, the right eye sees in the same row, farther left. The
command reports exchanged eyes, rows that lie apart and images without contrast. Where the result would be meaningless,
it writes nothing and exits with 2; --unchecked writes it nevertheless. Rows that lie a little apart, as in a rig whose
calibration has aged, it aligns by turning the right image.
Images as a camera takes them are rectified by m3depth.rectify first.

A calibration file (KITTI, Middlebury, ETH3D, OpenCV's stereoRectify, ROS CameraInfo, a rig file of marssim or a
dataset's sample.json) gives the focal lengths, the principal point and the baseline; flags beside it replace its
values. The command writes into RESULT:

    depth.npy          float32 [m]; inf: sky, or too far to be measured; NaN: unknown
    depth.png          uint16 [mm]; 0: none, or farther than 65.5 m
    disparity.npy      float32 [px], f B / depth; it includes the difference of the eyes' principal points (doffs)
    disparity.png      uint16, disparity times 256; 0: none, or 256 px and more
    normal.npy         float32, camera frame (x right, y down, z forward); 0 0 0: none (sky, or unknown)
    normal.png         red right, green up, blue to the camera; black: none
    confidence.npy     float32, 0 to 1
    left_right.npy     float32 [px], with --left-right: difference of both eyes' disparities; NaN: seen by one eye alone
    cloud.ply          coloured points [m], camera frame, without points that hang between two surfaces
    figure.png         image, depth, normals and confidence
    prediction.json    method, SHA-256 of its weights, runtime, what was done to the rows, versions of packages
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from inspect import signature
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tyro

from m3depth.datasets.image_files import read_pair
from m3depth.datasets.rigs import NATECAM_NAME, natecam
from m3depth.estimator import M3DEPTH, Estimator, EstimatorName, load_estimator
from m3depth.prediction.common_disparity import given_back, nearest_without, taken_out
from m3depth.prediction.files import without_sky_normals, write_prediction
from m3depth.prediction.left_right import left_right_difference
from m3depth.prediction.pair_checks import check_pair, rows_of
from m3depth.prediction.settings import with_settings
from m3depth.runtimes.choice import RuntimeChoice, recorded_runtime
from m3depth.stereo.pairs import NEAREST
from m3depth.stereo.prediction import Prediction
from m3depth.stereo.rows import RowFit, aligned_right
from marssim.base.calibration.rectified import Calibration, align_right, read_calibration
from marssim.base.camera import WIDEST_BASELINE, StereoRig
from marssim.base.command.run import run_command
from marssim.base.command.wording import counted
from marssim.base.files.atomic import write_atomically
from marssim.base.files.json_file import write_json
from marssim.base.files.npy import encode_npy
from marssim.base.results.claim import ResultFolder
from marssim.base.results.code_state import versions

AGREEMENT = 1.0  # [px] largest difference of both eyes' disparities that counts as agreement
MIN_ANGLE, MAX_ANGLE = 1.0, 150.0  # [deg] horizontal field of view of rectified images
NEAREST_LIMITS = (0.01, 1000.0)  # [m]
MIN_BASELINE = 0.001  # [m] shortest distance of the cameras


@dataclass(frozen=True)
class PredictOptions:
    """Predict depth, normals and a point cloud of one rectified stereo pair."""

    left: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="LEFT")]
    """Left image file, grey or colour, of 8 or 16 bits."""
    right: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="RIGHT")]
    """Right image file, of the same size."""
    out: Path
    """Folder to write the results to."""
    focal: float | None = None
    """Focal length of the rectified images [px]. Without it, that of the calibration file."""
    baseline: float | None = None
    """Distance of the two cameras [m]. Without it, that of the calibration file."""
    calib: tuple[Path, ...] = ()
    """Calibration file of the pair, or "natecam" for Zhurong's cameras; --focal, --baseline, --cx and --cy replace its
    values. For ROS's CameraInfo, give the files of the left and the right eye, or that of the right one alone."""
    cx: float | None = None
    """Column of the left image's principal point [px], counted from 0. Without it, the calibration's or the middle."""
    cy: float | None = None
    """Row of the principal point [px], counted from 0. Without it, the calibration's or the middle."""
    weights: Path | None = None
    """Weights file (.safetensors) of m3depth.train to predict with; the same as --estimator m3depth:PATH. Without it,
    the shipped weights."""
    estimator: Annotated[str, tyro.conf.arg(aliases=["--method"])] = "m3depth"
    """Stereo method: m3depth (shipped weights), m3depth:PATH (other weights), sgbm or another classical method that
    m3depth.evaluate --baselines lists, or package.module:Class, a class without arguments that has infer(left, right,
    rig). --method is its name in release 0.1."""
    device: Literal["auto", "cpu", "cuda"] = "auto"
    """Device that M3Depth runs on; auto takes a GPU if there is one."""
    runtime: RuntimeChoice = "auto"
    """Program that runs M3Depth: pytorch; openvino, on the CPU, with the extra `fast`; or auto, which is openvino if it
    is installed and the device is the CPU, and else pytorch."""
    nearest: float | None = None
    """Nearest depth [m] in view, 0.01 to 1000 and 0.84 by default, for M3Depth or a class whose infer takes it. M3Depth
    finds up to 192 px of disparity, first in reduced images where this depth has more."""
    max_pixels: int | None = None
    """Largest number of pixels of an image that the network works on, for M3Depth or a class whose infer takes it.
    Larger images are reduced to it, which saves time and memory and loses detail; the maps have the images' size."""
    align_rows: bool = True
    """Turn the right image where its rows lie apart from those of the left one by a significant part of a pixel. The
    summary says by how much."""
    unchecked: bool = False
    """Write the result even where the pair shows that it is meaningless, and print a warning instead of an error."""
    left_right: bool = False
    """Predict from the right eye too, which takes twice as long, and set the confidence to 0 where its disparity
    differs by more than 1 px or is unknown."""
    min_confidence: float = 0.5
    """Least confidence, from 0 to 1, of the pixels of the point cloud."""
    max_range: float = 30.0
    """Largest depth [m] of the points of the point cloud."""


def make_calibration(options: PredictOptions, height: int, width: int) -> Calibration:
    """Return the calibration that the flags and the calibration file give.

    Args:
        options: The command's flags.
        height: Height of the images [px].
        width: Width of the images [px].

    Raises:
        FileNotFoundError: The calibration file is missing.
        ValueError: A flag or the file cannot be used; the message names it.
    """
    for flag, value in (("--focal", options.focal), ("--baseline", options.baseline)):
        if value is None and not options.calib:
            raise ValueError(f"{flag} is missing: give it, or a calibration file with --calib")
        if value is not None and not (np.isfinite(value) and value > 0):
            raise ValueError(f"{flag} must be positive, got {value}")
    for flag, value in (("--cx", options.cx), ("--cy", options.cy)):
        if value is not None and not np.isfinite(value):
            raise ValueError(f"{flag} must be finite, got {value}")
    for flag, value, side in (("--cx", options.cx, width), ("--cy", options.cy, height)):
        if value is not None and not -side <= value <= 2 * side:
            raise ValueError(f"{flag} {value:g} px lies far outside of images of {width} x {height} px")
    if not options.calib:
        assert options.focal is not None and options.baseline is not None
        middle = ((width - 1) / 2, (height - 1) / 2)
        from_file = Calibration(options.focal, options.focal, *middle, options.baseline)
    else:
        if len(options.calib) > 2:
            raise ValueError(f"--calib {options.calib[2]}: a pair has two calibration files at most, got a third")
        if options.calib == (NATECAM_NAME,):
            from_file = natecam(width, height)
        else:
            from_file = read_calibration(*options.calib, image=options.left, baseline=options.baseline)
    calibration = replace(
        from_file,
        fx=from_file.fx if options.focal is None else options.focal,
        fy=from_file.fy if options.focal is None else options.focal,
        cx=from_file.cx if options.cx is None else options.cx,
        cy=from_file.cy if options.cy is None else options.cy,
        baseline=from_file.baseline if options.baseline is None else options.baseline,
    )
    if calibration.size is not None and calibration.size != (width, height):
        size = f"{calibration.size[0]} x {calibration.size[1]}"
        raise ValueError(f"{options.calib[0]}: is for images of {size} px, {options.left} is {width} x {height}")
    _check_sense(calibration, width, options)
    return calibration


def _check_sense(calibration: Calibration, width: int, options: PredictOptions) -> None:
    """Raise ValueError for a focal length or a baseline that is most likely in another unit."""
    focal_from = "--focal" if not options.calib or options.focal else f"{options.calib[0]}: focal length"
    baseline_from = "--baseline" if not options.calib or options.baseline else f"{options.calib[0]}: baseline"
    angle = np.rad2deg(2 * np.arctan2(width / 2, calibration.fx))
    if not MIN_ANGLE <= angle <= MAX_ANGLE:
        raise ValueError(
            f"{focal_from} {calibration.fx:g} px makes images of {width} px {angle:.3g} deg wide; "
            "it is counted in pixels of these images"
        )
    if not MIN_BASELINE <= calibration.baseline <= WIDEST_BASELINE:
        raise ValueError(
            f"{baseline_from} {calibration.baseline:g} m is out of [{MIN_BASELINE:g}, {WIDEST_BASELINE:g}] m; "
            "give --baseline in metres"
        )


def predict(options: PredictOptions, estimator: Estimator | None = None) -> Prediction:
    """Read the pair, predict, write the files, and print a summary in one line; warnings go to stderr.

    Args:
        options: The command's flags.
        estimator: A method to use instead of the one that the flags name.

    Raises:
        FileNotFoundError: A file is missing; nothing was written.
        ValueError: A flag or the pair cannot be used; nothing was written.
    """
    left, right = read_pair(options.left, options.right)
    calibration = make_calibration(options, *left.shape[:2])
    rig = calibration.rig(left.shape[1], left.shape[0])
    folder = ResultFolder(options.out, "prediction")
    folder.check()
    _check_method_and_cloud(options)
    record: dict[str, Any] = {"estimator": type(estimator).__name__}
    if estimator is None:
        name, flag = options.estimator, "--estimator"
        if options.weights is not None:
            name, flag = f"{M3DEPTH}:{options.weights}", "--weights"
        estimator = load_estimator(name, flag, device=options.device, runtime=options.runtime)
        runtime = recorded_runtime([name], options.runtime, options.device)
        record = {"estimator": name, "sha256": EstimatorName(name).digest(), "runtime": runtime}
    common = taken_out(calibration.shift, left.shape[1])
    nearest = options.nearest
    if common and (nearest is not None or "nearest" in signature(estimator.infer).parameters):
        nearest = nearest_without(nearest or NEAREST, rig, common)
    infer = with_settings(estimator, options.estimator, nearest=nearest, max_pixels=options.max_pixels)
    right = align_right(right, calibration.shift - common)
    rows = rows_of(left, right, rig)
    _check_pair(left, right, rig, rows, options)
    removed = rows if options.align_rows and rows is not None and rows.significant else None
    if removed is not None:
        right = aligned_right(right, rig, removed)

    prediction = without_sky_normals(infer(left, right, rig))
    difference = left_right_difference(infer, left, right, rig, prediction) if options.left_right else None
    if difference is not None:
        agree = difference <= AGREEMENT
        prediction = replace(prediction, confidence=np.where(agree, prediction.confidence, np.float32(0)))
    prediction = given_back(prediction, rig, common)
    with folder.claim():
        count = write_prediction(options.out, left, prediction, rig, options.min_confidence, options.max_range)
        record |= {"rows_aligned": None if removed is None else str(removed), "versions": versions()}
        write_json(options.out / "prediction.json", record, sort_keys=False)
        file = options.out / "left_right.npy"
        file.unlink(missing_ok=True)  # of an earlier run
        if difference is not None:
            write_atomically(file, encode_npy(difference))
    print(f"{options.out}: {_summary(prediction, count, difference, removed)}")
    return prediction


def _check_method_and_cloud(options: PredictOptions) -> None:
    """Raise ValueError that names a flag of the method or of the point cloud that cannot be used."""
    if options.estimator != M3DEPTH and options.weights is not None:
        raise ValueError(f"--weights is of m3depth, not of --estimator {options.estimator}: give one of the two")
    low, high = NEAREST_LIMITS
    if options.nearest is not None and not low <= options.nearest <= high:
        raise ValueError(f"--nearest must lie in [{low:g}, {high:g}] m, got {options.nearest:g}")
    if options.max_pixels is not None and not options.max_pixels > 0:
        raise ValueError(f"--max-pixels must be positive, got {options.max_pixels}")
    if not 0 <= options.min_confidence <= 1:
        raise ValueError(f"--min-confidence must be 0 to 1, got {options.min_confidence:g}")
    if not options.max_range > 0:
        raise ValueError(f"--max-range must be positive, got {options.max_range:g}")


def _check_pair(
    left: np.ndarray, right: np.ndarray, rig: StereoRig, rows: RowFit | None, options: PredictOptions
) -> None:
    """Print what speaks against a pair. Raise ValueError where the result would be meaningless, unless --unchecked."""
    names = str(options.left), str(options.right)
    for fatal, message in check_pair(left, right, rig, rows, options.align_rows, names):
        if fatal and not options.unchecked:
            raise ValueError(f"{message}; nothing was written (--unchecked writes the result nevertheless)")
        print(f"warning: {message}", file=sys.stderr)


def _summary(prediction: Prediction, points: int, difference: np.ndarray | None, removed: RowFit | None) -> str:
    """Return the depths of a prediction, and what was done to the rows, in a line.

    Args:
        prediction: The maps.
        points: Number of points of the cloud.
        difference: (H, W) left_right_difference [px], or None.
        removed: The misalignment of rows that was taken out, or None.
    """
    known = np.isfinite(prediction.depth)
    depths = "no depth"
    if known.any():
        low, middle, high = np.percentile(prediction.depth[known], [5, 50, 95])
        depths = f"depth {low:.2f} to {high:.2f} m (5 to 95 %), median {middle:.2f} m"
    line = f"{depths} on {100 * known.mean():.0f} % of the pixels; {counted(points, 'point')}"
    if removed is not None:
        line = f"{line}; rows aligned, which lay apart by {removed}"
    if difference is None or not (compared := known & np.isfinite(difference)).any():
        return line
    share = 100 * (difference[compared] <= AGREEMENT).mean()
    return f"{line}; the eyes agree within {AGREEMENT:g} px on {share:.1f} % of what both see"


def main(args: Sequence[str] | None = None) -> int:
    """Run the command, and return its exit code: 2 for a mistake of the user, and for images that are no pair."""
    return run_command(
        predict, PredictOptions, "python -m m3depth.predict", __doc__, args, "the results may be incomplete"
    )


if __name__ == "__main__":
    sys.exit(main())
