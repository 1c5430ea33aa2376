"""Depth, normals and a point cloud of one rectified stereo pair.

    python -m m3depth.predict left.png right.png --focal 595.9 --baseline 0.27 --out RESULT
    python -m m3depth.predict image_2/000000_10.png image_3/000000_10.png --calib calib.txt --out RESULT
    python -m m3depth.predict left.png right.png --calib left.yaml right.yaml --out RESULT      # ROS CameraInfo

The images must be rectified: what the left eye sees at a pixel, the right eye sees in the same row, farther left. Eyes
that are exchanged, rows that lie apart and images without contrast are told, and nothing is written where the result
would mean nothing (exit code 2; --unchecked writes it all the same).
A calibration file (KITTI, Middlebury, ETH3D, OpenCV's stereoRectify, ROS CameraInfo, a rig file of marssim or a
dataset's sample.json) gives the focal lengths, the principal point and the baseline; flags given beside it replace what
it says. Writes into RESULT:

    depth.npy          float32 [m]; inf: sky or beyond measure, NaN: unknown
    depth.png          uint16 [mm]; 0: none, or farther than 65.5 m
    disparity.npy      float32 [px], f B / depth: with a calibration whose eyes have different principal points (doffs),
                       that difference is in it;  disparity.png: uint16, times 256; 0: none, or 256 px and more
    normal.npy         float32, camera frame (x right, y down, z forward); 0 0 0: none (sky, or unknown)
    normal.png         red right, green up, blue to the camera, black: none
    confidence.npy     float32, 0 to 1
    left_right.npy     float32 [px], with --left-right: how far both eyes' disparities differ; NaN: out of sight
    cloud.ply          coloured points [m], camera frame, without what hangs between two surfaces
    figure.png         all of it at a glance
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tyro

from m3depth.datasets.calibration import Calibration, align_right, read_calibration
from m3depth.datasets.image_files import read_pair
from m3depth.datasets.rigs import NATECAM_NAME, natecam
from m3depth.estimator import Estimator, load_estimator
from m3depth.prediction.closer_look import closer_look, takes_nearest
from m3depth.prediction.files import without_sky_normals, write_prediction
from m3depth.prediction.left_right import left_right_difference
from m3depth.prediction.pair_checks import check_pair
from m3depth.stereo.prediction import Prediction
from marssim.base.camera import WIDEST, StereoRig
from marssim.base.command.notes import counted
from marssim.base.command.run import run_command
from marssim.base.files.atomic import write_atomically
from marssim.base.files.npy import encode_npy
from marssim.base.results.claim import ResultFolder

AGREEMENT = 1.0  # [px] that both eyes may differ by
MIN_ANGLE, MAX_ANGLE = 1.0, 150.0  # [deg] horizontal field of view of rectified images
MIN_BASELINE = 0.001  # [m]


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
    """Focal length of the rectified images [px]; default: the calibration file's."""
    baseline: float | None = None
    """Distance of the two cameras [m]; default: the calibration file's."""
    calib: tuple[Path, ...] = ()
    """Calibration file, or "natecam": what --focal, --baseline, --cx and --cy need not say; given beside it, they
    replace what it says. Of ROS's CameraInfo the left and the right eye's file, or the right one's alone."""
    cx: float | None = None
    """Principal point, column of the left image [px] from 0; default: the calibration's, or the middle."""
    cy: float | None = None
    """Principal point, row [px] from 0; default: the calibration's, or the middle."""
    weights: Path | None = None
    """A .safetensors file written by m3depth.train; default: the weights that come with the package."""
    method: str = "m3depth"
    """m3depth, m3depth:WEIGHTS, sgbm, ssd, sad, ncc, ssd-sgm, sad-sgm, ncc-sgm, or package.module:Class (a class with
    infer(left, right, rig))."""
    device: Literal["auto", "cpu", "cuda"] = "auto"
    """What M3Depth computes on; auto: a GPU if there is one."""
    nearest: float | None = None
    """Nearest depth [m] that M3Depth, or a class whose infer takes it, has to see. What is nearer than 192 px of
    disparity is seen in reduced images; default: 0.84 m at first, and then again, less reduced, if all is farther."""
    unchecked: bool = False
    """Write what comes out even where the pair shows that it means nothing; what is wrong is then a warning."""
    left_right: bool = False
    """Look from the right eye, too, which takes twice as long; where its disparity differs by more than 1 px, or where
    it sees nothing, the confidence becomes 0."""
    min_confidence: float = 0.5
    """Pixels of less confidence, 0 to 1, are left out of the point cloud."""
    max_range: float = 30.0
    """Points farther ahead [m] are left out of the point cloud."""


def make_calibration(options: PredictOptions, height: int, width: int) -> Calibration:
    """What the options and the calibration file say of a pair of this size.

    Raises FileNotFoundError or ValueError that names the flag or the file.
    """
    for flag, value in (("--focal", options.focal), ("--baseline", options.baseline)):
        if value is None and not options.calib:
            raise ValueError(f"{flag} is missing; or give a calibration file with --calib")
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
        found = Calibration(options.focal, options.focal, *middle, options.baseline)
    else:
        if len(options.calib) > 2:
            raise ValueError(f"--calib {options.calib[2]}: a pair has two calibration files at most, got a third")
        if options.calib == (NATECAM_NAME,):
            found = natecam(width, height)
        else:
            found = read_calibration(*options.calib, image=options.left, baseline=options.baseline)
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
        raise ValueError(f"{options.calib[0]}: is for images of {meant} px, {options.left} is {width} x {height}")
    _check_sense(calibration, width, options)
    return calibration


def _check_sense(calibration: Calibration, width: int, options: PredictOptions) -> None:
    """Raise ValueError for a focal length or a baseline that is most likely of another unit."""
    focal_from = "--focal" if not options.calib or options.focal else f"{options.calib[0]}: focal length"
    baseline_from = "--baseline" if not options.calib or options.baseline else f"{options.calib[0]}: baseline"
    angle = np.rad2deg(2 * np.arctan2(width / 2, calibration.fx))
    if not MIN_ANGLE <= angle <= MAX_ANGLE:
        raise ValueError(
            f"{focal_from} {calibration.fx:g} px makes images of {width} px {angle:.3g} deg wide; "
            "it is counted in pixels of these images"
        )
    if not MIN_BASELINE <= calibration.baseline <= WIDEST:
        raise ValueError(
            f"{baseline_from} {calibration.baseline:g} m is out of [{MIN_BASELINE:g}, {WIDEST:g}] m; "
            "give --baseline in metres"
        )


def predict(options: PredictOptions, estimator: Estimator | None = None) -> Prediction:
    """Read the pair, estimate, write the files, say in one line what came out.

    estimator: instead of the one that the options name. Raises FileNotFoundError or ValueError with one line for the
    user, before anything is written. What is doubtful of the pair is told on stderr.
    """
    left, right = read_pair(options.left, options.right)
    calibration = make_calibration(options, *left.shape[:2])
    rig = calibration.rig(left.shape[1], left.shape[0])
    folder = ResultFolder(options.out, "prediction")
    folder.check()
    if options.method != "m3depth" and options.weights is not None:
        raise ValueError(f"--weights belongs to m3depth, not to --method {options.method}")
    if options.nearest is not None and not (np.isfinite(options.nearest) and options.nearest > 0):
        raise ValueError(f"--nearest must be positive, got {options.nearest}")
    if not 0 <= options.min_confidence <= 1:
        raise ValueError(f"--min-confidence must be 0 to 1, got {options.min_confidence:g}")
    if not options.max_range > 0:
        raise ValueError(f"--max-range must be positive, got {options.max_range:g}")
    if estimator is None:
        spec = options.method if options.weights is None else f"m3depth:{options.weights}"
        estimator = load_estimator(spec, "--method", device=options.device)
    if options.nearest is not None and not takes_nearest(estimator):
        raise ValueError(f"--nearest: --method {options.method} cannot be told how near it has to see")
    right = align_right(right, calibration.shift)
    doubts = check_pair(left, right, rig, (str(options.left), str(options.right)))
    for fatal, message in doubts:
        if fatal and not options.unchecked:
            raise ValueError(f"{message}; nothing was written (--unchecked does it all the same)")
        print(f"warning: {message}", file=sys.stderr)

    def look(left: np.ndarray, right: np.ndarray, rig: StereoRig) -> Prediction:
        return closer_look(estimator, left, right, rig, nearest=options.nearest)

    prediction = without_sky_normals(look(left, right, rig))
    difference = left_right_difference(look, left, right, rig, prediction) if options.left_right else None
    if difference is not None:
        agree = difference <= AGREEMENT
        prediction = replace(prediction, confidence=np.where(agree, prediction.confidence, np.float32(0)))
    with folder.claim():
        count = write_prediction(options.out, left, prediction, rig, options.min_confidence, options.max_range)
        file = options.out / "left_right.npy"
        file.unlink(missing_ok=True)  # of an earlier run
        if difference is not None:
            write_atomically(file, encode_npy(difference))
    agreed = ""
    if difference is not None:
        compared = np.isfinite(prediction.depth) & np.isfinite(difference)
        if compared.any():
            agreed = (
                f"; the eyes agree within {AGREEMENT:g} px on {100 * agree[compared].mean():.1f} % of what both see"
            )
    known = prediction.depth[np.isfinite(prediction.depth)]
    seen = "no depth"
    if len(known):
        low, middle, high = np.percentile(known, [5, 50, 95])
        seen = f"depth {low:.2f} to {high:.2f} m (5 to 95 %), median {middle:.2f} m"
    share = 100 * len(known) / prediction.depth.size
    print(f"{options.out}: {seen} on {share:.0f} % of the pixels; {counted(count, 'point')}{agreed}")
    return prediction


def main(args: Sequence[str] | None = None) -> int:
    """The command. Returns the exit code: 2 for a mistake in what was asked for, and for pairs that are none."""
    return run_command(
        predict, PredictOptions, "python -m m3depth.predict", __doc__, args, "the results may be incomplete"
    )


if __name__ == "__main__":
    sys.exit(main())
