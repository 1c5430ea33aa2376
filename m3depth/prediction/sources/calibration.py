"""The calibration of a pair, from flags and files, and whether it can be that of its images."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from m3depth.datasets.config import DataConfig
from m3depth.datasets.oaisys import oaisys_rig
from m3depth.datasets.pair_files import CalibrationReader
from m3depth.datasets.rigs import NATECAM_NAME, natecam
from m3depth.prediction.options import PredictOptions
from m3depth.rectification.files import REPORT, rig_beside
from marssim.base.calibration.rectified import Calibration, read_calibration
from marssim.base.camera import NARROWEST_BASELINE, WIDEST_BASELINE

MIN_ANGLE, MAX_ANGLE = 1.0, 150.0  # [deg] horizontal field of view of rectified images
# A calibration without a size is for images of another size if its principal point lies in the outer 27 % of both the
# width and the height, towards the same corner.
OFF_MIDDLE = 0.27


def make_calibration(
    options: PredictOptions, height: int, width: int, image: Path, pair_calibration: CalibrationReader | None = None
) -> Calibration:
    """Return the calibration that the flags and the calibration file give.

    Args:
        options: The command's flags.
        height: Height of the images [px].
        width: Width of the images [px].
        image: The left image, or the video.
        pair_calibration: Reads the calibration that a dataset has for this pair. --calib replaces it.

    Raises:
        FileNotFoundError: The calibration file is missing.
        ValueError: A flag or the file cannot be used; the message names it.
    """
    files = options.calib
    if not files and pair_calibration is None and (beside := rig_beside(image)).is_file():
        files = (beside,)
    for flag, value in (("--focal", options.focal), ("--baseline", options.baseline)):
        if value is None and not files and pair_calibration is None:
            aligned = image.with_name(REPORT)  # of m3depth.rectify, which wrote no rig file
            reason = f" (nothing gave {image.parent} a scale, see {aligned.name})" if aligned.is_file() else ""
            raise ValueError(f"{flag} is missing{reason}: give it, or a calibration file with --calib")
    for flag, value, side in (("--cx", options.cx, width), ("--cy", options.cy, height)):
        if value is not None and not -side <= value <= 2 * side:
            raise ValueError(f"{flag} {value:g} px lies far outside of images of {width} x {height} px")
    if files == (NATECAM_NAME,):
        given = natecam(width, height)
    elif len(files) == 1 and (sensors := oaisys_rig(files[0], DataConfig(left=options.left, right=options.right))):
        given = sensors
    elif files:
        given = read_calibration(*files, image=image, baseline=options.baseline)
    elif pair_calibration is not None:
        given = pair_calibration(width, height)
    else:
        assert options.focal is not None and options.baseline is not None
        given = Calibration(options.focal, options.focal, (width - 1) / 2, (height - 1) / 2, options.baseline)
    calibration = replace(
        given,
        fx=given.fx if options.focal is None else options.focal,
        fy=given.fy if options.focal is None else options.focal * given.fy / given.fx,
        cx=given.cx if options.cx is None else options.cx,
        cy=given.cy if options.cy is None else options.cy,
        baseline=given.baseline if options.baseline is None else options.baseline,
    )
    if calibration.size is not None and calibration.size != (width, height):
        size = f"{calibration.size[0]} x {calibration.size[1]}"
        raise ValueError(f"{files[0] if files else image}: is for images of {size} px, {image} is {width} x {height}")
    source = str(files[0] if files else image)
    was_read = files or pair_calibration is not None  # else the principal point is the middle of these images
    if was_read and calibration.size is None and (options.cx is None or options.cy is None):
        _check_middle(calibration, (width, height), source, image)
    _check_sense(calibration, width, options, source)
    return calibration


def note_rig_beside(options: PredictOptions, image: Path) -> None:
    """Print a note if a rig file beside an image gives what --focal and --baseline do not.

    m3depth.rectify writes its report beside the rig file, which is of these images then, and needs no note.

    Args:
        options: The command's flags.
        image: The first left image, or the video.
    """
    beside = rig_beside(image)
    asked = options.focal is not None and None in (options.cx, options.cy)
    if asked and not options.calib and beside.is_file() and not beside.with_name(REPORT).is_file():
        baseline = "" if options.baseline is not None else "the baseline, "
        print(
            f"note: {beside}, which lies beside the images, gives what the flags do not: {baseline}the principal "
            "point, and the shift of cameras that converge",
            file=sys.stderr,
        )


def _check_middle(calibration: Calibration, size: tuple[int, int], source: str, image: Path) -> None:
    """Raise ValueError if the principal point tells that a calibration without a size is for images of another one."""
    place = [at / side for at, side in zip((calibration.cx, calibration.cy), size, strict=True)]
    if all(x > 1 - OFF_MIDDLE for x in place) or all(x < OFF_MIDDLE for x in place):
        raise ValueError(
            f"{source}: the principal point ({calibration.cx:g}, {calibration.cy:g}) px lies near a corner of {image}, "
            f"{size[0]} x {size[1]} px: it is for images of another size; if these are a part of them, give --cx and "
            "--cy"
        )


def _check_sense(calibration: Calibration, width: int, options: PredictOptions, source: str) -> None:
    """Raise ValueError for a focal length or a baseline that is most likely in another unit."""
    focal_from = f"{source}: focal length" if options.focal is None else "--focal"
    baseline_from = f"{source}: baseline" if options.baseline is None else "--baseline"
    angle = np.rad2deg(2 * np.arctan2(width / 2, calibration.fx))
    if not MIN_ANGLE <= angle <= MAX_ANGLE:
        raise ValueError(
            f"{focal_from} {calibration.fx:g} px makes images of {width} px {angle:.3g} deg wide; "
            "it is counted in pixels of these images"
        )
    if not NARROWEST_BASELINE <= calibration.baseline <= WIDEST_BASELINE:
        raise ValueError(
            f"{baseline_from} {calibration.baseline:g} m is out of [{NARROWEST_BASELINE:g}, {WIDEST_BASELINE:g}] m; "
            "give --baseline in metres"
        )
