"""Rectify a raw pair as flags say, and judge by its matches whether the result can be right."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from m3depth.rectification.files import make_report, write_pair
from m3depth.rectification.options import RectifyOptions
from m3depth.rectification.pair import RectifiedPair, fitting, rectify_pair
from m3depth.rectification.raw_image import RawImage, masked
from m3depth.rectification.row_errors import WRONG_ROWS, row_limit
from marssim.base.calibration.cameras import PosedPair
from marssim.base.calibration.lenses.coverage import check_lens
from marssim.base.calibration.read_pair import labelled_pair, read_raw_calibration
from marssim.base.calibration.rectified import Calibration

NEEDS_CALIB = "--fisheye is of a calibration with OpenCV's names: give it with --calib, or leave --fisheye out"
AS_THEY_ARE = "none of the raw cameras: focal length and baseline are given for the images as they are"
FEW = 100  # matches under which the rows are hardly judged
IN_ROWS = 0.5  # [px] by which the rows of rectified images may lie apart
LEAST_ROWS, WORSE = 0.1, 3.0  # [px] and factor: rows that lie this much farther apart than before show a mistake


@dataclass(frozen=True)
class CheckedPair:
    """A rectified pair with its report and warnings.

    Attributes:
        left, right: The raw images, without what masks leave out.
        pair: The rectified pair.
        report: What report.json holds.
        warnings: What speaks against the pair, without making it meaningless.
    """

    left: RawImage
    right: RawImage
    pair: RectifiedPair
    report: dict[str, Any]
    warnings: list[str]

    def write(self, out: Path, with_picture: bool = True) -> None:
        """Write every file that m3depth.rectify lists. Raises as write_pair."""
        write_pair(out, self.left, self.right, self.pair, self.report, with_picture)

    def with_scale(self, calibration: Calibration) -> CheckedPair:
        """Return a pair without a calibration of the raw cameras, with that of the images as they are.

        Args:
            calibration: Of the images as they are; the rectified ones keep their geometry.
        """
        height, width = self.pair.left_valid.shape
        pair = replace(self.pair, given=replace(calibration, size=(width, height)))
        return replace(self, pair=pair, report=make_report(self.left, self.right, pair, AS_THEY_ARE))

    def summary(self) -> str:
        """Return what was done, in a line."""
        pair = self.pair
        height, width = pair.left_valid.shape
        parts = [f"{width} x {height} px"]
        if (scale := pair.calibration) is None:
            parts.append("no scale: depth has no unit")
        else:
            parts.append(f"focal length {scale.fx:.1f} px, baseline {scale.baseline:.5f} m")
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


def rectified(options: RectifyOptions, left: RawImage, right: RawImage) -> CheckedPair:
    """Rectify a raw pair.

    Args:
        options: The flags of m3depth.rectify.
        left, right: The raw images.

    Returns:
        The rectified pair with its report and warnings; nothing is written.

    Raises:
        FileNotFoundError: A file is missing.
        ValueError: A calibration or a mask cannot be used, or the result would be meaningless.
    """
    cameras, source = _calibration(options, left, right)
    warnings = [] if cameras is None else _lens_warnings(cameras, options, (left, right))
    if cameras is not None:
        notes = dict.fromkeys(camera.note for camera in (cameras.left, cameras.right) if camera.note)
        warnings += [f"{left.path} and {right.path}: {note}" for note in notes]
    for number, mask in enumerate(options.mask):
        left, right = (masked(left, mask), right) if number == 0 else (left, masked(right, mask))
    pair = rectify_pair(left, right, cameras, options.focal, options.size, options.shift, options.raw.align)
    warnings += _judged(pair, left, right, options)
    return CheckedPair(left, right, pair, make_report(left, right, pair, source), warnings)


def _calibration(options: RectifyOptions, left: RawImage, right: RawImage) -> tuple[PosedPair | None, str]:
    """Return the calibration of the raw pair, from --calib or the labels, and where it is from.

    Raises:
        ValueError: There is none, and --align does not ask for one.
    """
    if options.raw.fisheye and not options.calib:
        raise ValueError(NEEDS_CALIB)
    if options.calib:
        name = " and ".join(map(str, options.calib))
        cameras = read_raw_calibration(options.calib, options.raw.fisheye)
    elif left.label is not None and left.label.camera is not None:
        name = "the labels of the images"
        cameras = labelled_pair((left.label, right.label), (left.path, right.path))
    elif options.raw.align:
        for flag, value in (("--size", options.size), ("--shift", options.shift)):
            if value is not None:
                raise ValueError(f"{flag} needs a calibration: without one the images keep their geometry")
        return None, "none"
    else:
        raise ValueError(
            f"{left.path} has no label with a camera model: give its calibration with --calib, "
            "or --align to fit the rows without one"
        )
    try:
        return fitting(cameras, left, right), name
    except ValueError as error:
        raise ValueError(f"{error} ({name})") from None


def _lens_warnings(cameras: PosedPair, options: RectifyOptions, images: tuple[RawImage, RawImage]) -> list[str]:
    """Raise ValueError if a lens folds over well inside its image; with --unchecked, return that."""
    warnings = []
    files = [*options.calib, *options.calib][:2] or [image.path for image in images]
    for eye, file, image in zip(("left", "right"), files, images):
        try:
            check_lens(getattr(cameras, eye).lens, image.size, f"{file}: the distortion of the {eye} camera")
        except ValueError as error:
            if not options.unchecked:
                raise ValueError(f"{error} (--unchecked rectifies the others)") from None
            warnings.append(str(error))
    return warnings


def _judged(pair: RectifiedPair, left: RawImage, right: RawImage, options: RectifyOptions) -> list[str]:
    """Return what speaks against a pair. Raise ValueError where the result would be meaningless, unless --unchecked."""
    warnings = []
    for fatal, message in _findings(pair, f"{left.path} and {right.path}"):
        if fatal and not options.unchecked:
            raise ValueError(f"{message}; nothing was written (--unchecked writes the result nevertheless)")
        warnings.append(message)
    return warnings


def _findings(pair: RectifiedPair, names: str) -> list[tuple[bool, str]]:
    """Return whether each finding makes a result meaningless, and its message."""
    if not (pair.left_valid.any() and pair.right_valid.any()):
        return [(True, f"{names} show nothing in the rectified view: is the calibration that of these images?")]
    if pair.matches is None:
        return [(False, f"too few points of {names} match in common rows to judge them")]
    matches, shift = pair.matches, 0.0 if pair.view is None else pair.view.shift
    findings = []
    expected_most = WORSE * max(matches.before.median, LEAST_ROWS) * _enlargement(pair)
    if np.median(matches.disparity + shift) < 0:
        beyond = "" if pair.view is not None else ", or the cameras are turned towards each other"
        findings.append((True, f"{names} match the wrong way round: exchange left and right{beyond}"))
    if matches.after.median > row_limit(WRONG_ROWS, pair.left_valid.shape[1]):
        apart = f"the rows of {names} lie {matches.after.median:.1f} px apart after rectification (median)"
        question = "is the calibration that of these images, and the left image the first one?"
        findings.append((True, f"{apart}: {question} --align fits the rows to matches"))
    elif matches.before.median < IN_ROWS and matches.after.median > expected_most:
        rows = f"{matches.before.median:.2f} px apart before, and {matches.after.median:.2f} px after (medians)"
        findings.append((True, f"the rows of {names} lay {rows}: are the images rectified already?"))
    elif matches.after.points < FEW:
        findings.append((False, f"only {matches.after.points} points of {names} match: the rows are hardly judged"))
    return findings


def _enlargement(pair: RectifiedPair) -> float:
    """Return how much larger the rectified image shows things than the raw one, at least 1."""
    if pair.view is None or pair.cameras is None:
        return 1.0
    return max(1.0, pair.view.left.fx / pair.cameras.left.lens.focal())
