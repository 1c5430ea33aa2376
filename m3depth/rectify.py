"""Rectify a raw stereo pair by its calibration, and report how far its rows lie apart, before and after.

    python -m m3depth.rectify left.png right.png --calib stereo.yml --out RESULT
    python -m m3depth.rectify left.png right.png --calib left.yaml right.yaml --out RESULT      # ROS CameraInfo
    python -m m3depth.rectify NLMV0709_...IMG NRMV0709_...IMG --out RESULT      # the labels hold the camera models
    python -m m3depth.rectify NLMV0709_...IMG --out RESULT                      # the right image is found by its name
    python -m m3depth.rectify left.jpg right.jpg --align --out RESULT           # no calibration: rows from matches

--calib takes calibrations of raw cameras: OpenCV's K1 D1 K2 D2 R T as YAML, XML or JSON (--fisheye for those of
cv2.fisheye), ROS CameraInfo of both cameras, Kalibr's camchain.yaml, and labels of PDS3, VICAR and PDS4 with a CAHV,
CAHVOR or CAHVORE model. The images may be products of missions (.IMG, PDS4 labels), which need the extra `real`; their
labels are the calibration. The command writes into RESULT:

    left.png, right.png                the rectified pair, of as many bits as the raw one
    left_valid.png, right_valid.png    255: the image shows the scene here
    rig.json          focal length, principal point and baseline, as marssim and `m3depth.predict --calib` read them;
                      "shift" is the common disparity that was taken out: depth = fx baseline / (disparity + shift);
                      "camera_to_rover" is the left camera's pose on the rover, where labels give it
    report.json       rows before and after, what was taken out, vergence, disparities, and whether depth has a scale
    rows.png          matched rows of the raw and of the rectified pair, to look at

The pair can then be predicted: python -m m3depth.predict RESULT/left.png RESULT/right.png --calib RESULT/rig.json
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from m3depth.rectification.files import make_report, write_pair
from m3depth.rectification.pair import RectifiedPair, fitting, rectify_pair
from m3depth.rectification.product_names import right_of
from m3depth.rectification.raw_image import RawImage, masked, read_raw_pair
from marssim.base.calibration.cameras import PosedPair
from marssim.base.calibration.lenses.coverage import check_lens
from marssim.base.calibration.read_pair import labelled_pair, read_pair
from marssim.base.command.run import run_command
from marssim.base.results.claim import ResultFolder

WRONG_ROWS = 2.5  # [px] from which on a pair of 1024 px width is not rectified
FULL_WIDTH = 1024
LARGEST = 16_384  # [px] side of a rectified image
FEW = 100  # matches under which the rows are hardly judged


@dataclass(frozen=True)
class RectifyOptions:
    """Rectify a raw stereo pair by its calibration, and report how far its rows lie apart."""

    images: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="LEFT [RIGHT]")]
    """Left and right image file. For products of Mars 2020 and MSL the left one alone is enough: its name tells the
    right one."""
    out: Path
    """Folder to write the results to."""
    calib: tuple[Path, ...] = ()
    """Calibration of the raw cameras: one file of the pair, or those of the left and of the right camera. Without it,
    the labels of the images."""
    fisheye: bool = False
    """Take four coefficients of distortion in OpenCV's names for those of cv2.fisheye."""
    focal: float | None = None
    """Focal length of the rectified images [px]. Without it, the shortest one that leaves no empty border, between half
    of the lenses' own and all of it."""
    size: tuple[int, int] | None = None
    """Width and height of the rectified images [px]. Without it, those of the left image."""
    shift: float | None = None
    """Disparity [px] to take out of all pixels, which rig.json gives back. Without it, one is chosen where the cameras
    are turned towards each other; 0 takes out none."""
    align: bool = False
    """Fit the rows to matches with six terms: for a calibration that is nearly right, or for none. Without it, a
    constant row offset is taken out."""
    mask: tuple[Path, ...] = ()
    """Mask of the left raw image, or of both: an image file whose pixels of 0 are left out, such as those of the rover
    itself."""
    unchecked: bool = False
    """Write the result even where the pair shows that it is meaningless, and print a warning instead of an error."""


def rectify(options: RectifyOptions) -> RectifiedPair:
    """Read the pair, rectify it, write the files, and print a summary.

    Args:
        options: The command's flags.

    Raises:
        FileNotFoundError: A file is missing; nothing was written.
        ImportError: A product without the extra `real`; nothing was written.
        ValueError: A flag, a calibration or the pair cannot be used; nothing was written.
    """
    _check_flags(options)
    paths = options.images if len(options.images) == 2 else (options.images[0], right_of(options.images[0]))
    folder = ResultFolder(options.out, "rectified pair")
    folder.check()
    left, right = read_raw_pair(*paths, check=not options.unchecked)
    cameras, source = _calibration(options, left, right)
    for number, mask in enumerate(options.mask):
        left, right = (masked(left, mask), right) if number == 0 else (left, masked(right, mask))
    pair = rectify_pair(left, right, cameras, options.focal, options.size, options.shift, options.align)
    _check(pair, left, right, options)
    report = make_report(left, right, pair, source)
    with folder.claim():
        write_pair(options.out, left, right, pair, report)
    print(f"{options.out}: {_summary(pair)}")
    return pair


def _check_flags(options: RectifyOptions) -> None:
    """Raise ValueError that names a flag that cannot be used."""
    if not 1 <= len(options.images) <= 2:
        raise ValueError(f"give a left and a right image, got {len(options.images)} files")
    if len(options.calib) > 2:
        raise ValueError(f"--calib {options.calib[2]}: a pair has two calibration files at most, got a third")
    if len(options.mask) > 2:
        raise ValueError(f"--mask {options.mask[2]}: a pair has two masks at most, got a third")
    if options.focal is not None and not (np.isfinite(options.focal) and options.focal > 0):
        raise ValueError(f"--focal must be positive, got {options.focal}")
    if options.size is not None and not all(16 <= side <= LARGEST for side in options.size):
        raise ValueError(f"--size must be 16 to {LARGEST} px, got {options.size[0]} {options.size[1]}")
    if options.shift is not None and not abs(options.shift) <= LARGEST:
        raise ValueError(f"--shift must be at most {LARGEST} px, got {options.shift}")


def _calibration(options: RectifyOptions, left: RawImage, right: RawImage) -> tuple[PosedPair | None, str]:
    """Return the calibration of the raw pair, from --calib or the labels, and where it is from.

    Raises:
        ValueError: There is none, and --align does not ask for one.
    """
    if options.calib:
        name = " and ".join(map(str, options.calib))
        cameras = read_pair(options.calib, options.fisheye)
    elif left.label is not None and left.label.camera is not None:
        name = "the labels of the images"
        cameras = labelled_pair((left.label, right.label), (left.path, right.path))
    elif options.align:
        for flag, value in (("--focal", options.focal), ("--size", options.size), ("--shift", options.shift)):
            if value is not None:
                raise ValueError(f"{flag} needs a calibration: without one the images keep their geometry")
        return None, "none"
    else:
        raise ValueError(
            f"{left.path} has no label with a camera model: give its calibration with --calib, "
            "or --align to fit the rows without one"
        )
    try:
        fitted = fitting(cameras, left, right)
    except ValueError as error:
        raise ValueError(f"{error} ({name})") from None
    _check_lenses(fitted, options, (left, right))
    return fitted, name


def _check_lenses(cameras: PosedPair, options: RectifyOptions, images: tuple[RawImage, RawImage]) -> None:
    """Raise ValueError if a lens folds over well inside its image; with --unchecked, print it."""
    files = [*options.calib, *options.calib][:2] or [image.path for image in images]
    for eye, file, image in zip(("left", "right"), files, images):
        try:
            check_lens(getattr(cameras, eye).lens, image.size, f"{file}: the distortion of the {eye} camera")
        except ValueError as error:
            if not options.unchecked:
                raise ValueError(f"{error} (--unchecked rectifies the others)") from None
            print(f"warning: {error}", file=sys.stderr)


def _check(pair: RectifiedPair, left: RawImage, right: RawImage, options: RectifyOptions) -> None:
    """Print what speaks against a pair. Raise ValueError where the result would be meaningless, unless --unchecked."""
    names = f"{left.path} and {right.path}"
    for fatal, message in _findings(pair, names):
        if fatal and not options.unchecked:
            raise ValueError(f"{message}; nothing was written (--unchecked writes the result nevertheless)")
        print(f"warning: {message}", file=sys.stderr)


def _findings(pair: RectifiedPair, names: str) -> list[tuple[bool, str]]:
    """Return whether each finding makes a result meaningless, and its message."""
    if not (pair.left_valid.any() and pair.right_valid.any()):
        return [(True, f"{names} show nothing in the rectified view: is the calibration that of these images?")]
    if pair.matches is None:
        return [(False, f"too few points of {names} match in common rows to judge them")]
    matches, shift = pair.matches, 0.0 if pair.view is None else pair.view.shift
    findings = []
    if np.median(matches.disparity + shift) < 0:
        beyond = "" if pair.view is not None else ", or the cameras are turned towards each other"
        findings.append((True, f"{names} match the wrong way round: exchange left and right{beyond}"))
    if matches.after.median > WRONG_ROWS * max(1.0, pair.left_valid.shape[1] / FULL_WIDTH):
        apart = f"the rows of {names} lie {matches.after.median:.1f} px apart after rectification"
        findings.append((True, f"{apart}: is the calibration that of these images? --align fits the rows to matches"))
    elif matches.after.points < FEW:
        findings.append((False, f"only {matches.after.points} points of {names} match: the rows are hardly judged"))
    return findings


def _summary(pair: RectifiedPair) -> str:
    """Return what was done, in a line."""
    height, width = pair.left_valid.shape
    parts = [f"{width} x {height} px"]
    if pair.view is None:
        parts.append("no scale: depth has no unit")
    else:
        parts.append(f"focal length {pair.view.left.fx:.1f} px, baseline {pair.view.baseline:.5f} m")
    if pair.matches is not None:
        before, after = pair.matches.before, pair.matches.after
        parts.append(
            f"rows {after.median:.2f} px apart, before {before.median:.2f} px (median of {after.points} matches)"
        )
    if pair.removed is not None:
        parts.append(f"taken out of the right image's rows: {pair.removed}")
    if pair.view is not None and pair.cameras is not None and pair.view.shift:
        angle = np.rad2deg(pair.cameras.vergence)
        parts.append(f"vergence {angle:.2f} deg: {pair.view.shift:g} px taken out of all disparities")
    return "; ".join(parts)


def main(args: Sequence[str] | None = None) -> int:
    """Run the command, and return its exit code: 2 for a mistake of the user, and for images that are no pair."""
    return run_command(
        rectify, RectifyOptions, "python -m m3depth.rectify", __doc__, args, "the results may be incomplete"
    )


if __name__ == "__main__":
    sys.exit(main())
