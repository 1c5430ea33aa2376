"""Checks whether two images are a rectified stereo pair, and whether left and right are exchanged."""

from __future__ import annotations

import cv2
import numpy as np

from m3depth.rectification.row_errors import WRONG_ROWS, row_limit
from m3depth.stereo.classical import SGBM, grey_pair
from m3depth.stereo.eye_order import exchanged
from m3depth.stereo.rows import RowFit, row_misalignment
from marssim.base.camera import StereoRig

QUICK_WIDTH = 256  # [px] width to which matched_shares reduces images
LITTLE, HARDLY_ANY = 0.15, 0.05  # shares of matching pixels under which a pair is doubtful, and meaningless
SMALLEST = 100  # [px] width under which too few matches are not held against a pair
DOUBTFUL_ROWS = 0.75  # [px] distance of rows that gives a warning; see row_limit
ROWS_REACH = 0.15  # share of the height by which rows may lie apart and still be found


def matched_shares(left: np.ndarray, right: np.ndarray, rig: StereoRig) -> tuple[float, float]:
    """Return the shares of the pixels that match in the given order, and with the eyes exchanged.

    SGBM matches images reduced to 256 columns.

    Args:
        left: (H, W) or (H, W, 3) uint8 left image.
        right: The right image, likewise.
        rig: The cameras of these images.

    Raises:
        ValueError: As SGBM.infer.
    """
    left, right = grey_pair(left, right, rig)
    scale = min(1.0, QUICK_WIDTH / rig.camera.width)
    small = rig.resized(round(rig.camera.width * scale), max(1, round(rig.camera.height * scale)))
    size = (small.camera.width, small.camera.height)
    a, b = (cv2.resize(image, size, interpolation=cv2.INTER_AREA) for image in (left, right))
    given, swapped = (float(np.isfinite(SGBM().match(*eyes, small)).mean()) for eyes in ((a, b), (b, a)))
    return given, swapped


def rows_of(left: np.ndarray, right: np.ndarray, rig: StereoRig) -> RowFit | None:
    """Return how the rows of a pair lie, even if they lie far apart; None if too few points match.

    Args:
        left: (H, W) or (H, W, 3) uint8 left image, of the rig's size.
        right: The right image, likewise.
        rig: The cameras of these images.
    """
    near = row_misalignment(left, right, rig)  # which finds more where little matches
    return near or row_misalignment(left, right, rig, max(1.0, ROWS_REACH * rig.camera.height))


def empty_or_same(left: np.ndarray, right: np.ndarray, names: tuple[str, str] = ("left", "right")) -> str | None:
    """Return what makes a pair meaningless at the first look: an image of one grey level, or twice the same image.

    Args:
        left: (H, W) or (H, W, 3) uint8 left image.
        right: The right image, likewise.
        names: What the message calls the images.
    """
    for name, image in zip(names, (left, right), strict=True):
        if image.min() == image.max():
            tone = "black" if image.max() == 0 else "of one grey level"
            return f"{name} is {tone}: there is nothing to match"
    if np.array_equal(left, right):
        return f"{names[0]} and {names[1]} are one and the same image"
    return None


def check_pair(
    left: np.ndarray, right: np.ndarray, rig: StereoRig, rows: RowFit | None = None, aligned: bool = False,
    names: tuple[str, str] = ("left", "right"),
) -> list[tuple[bool, str]]:  # fmt: skip
    """Return what speaks against a pair.

    The checks find images of one grey level, eyes that are one image or exchanged, pairs of which little matches, and
    rows that lie apart. Without alignment, M3Depth's error grows by 40 % where rows lie 1 px apart and threefold at 2
    px; at 3 px it measures nothing. Where they lie farther apart than calibrations age, disparities are wrong too,
    and alignment does not help. These limits grow with images wider than 1024 px. A pair in which neither points nor
    5 % of the pixels match is meaningless: images of different places match in 1 to 8 % of the pixels, simulated pairs
    with a seventh of the contrast, blurred and noisy, in at least 16 %.

    Args:
        left: (H, W) or (H, W, 3) uint8 left image, of the rig's size.
        right: The right image, likewise.
        rig: The cameras of these images.
        rows: What rows_of says about them.
        aligned: Whether `rows` will be taken out.
        names: What the messages call the images.

    Returns:
        Whether each finding makes the result meaningless, and its message.
    """
    if (fault := empty_or_same(left, right, names)) is not None:
        return [(True, fault)]
    shares = matched_shares(left, right, rig)
    if exchanged(shares):
        return [(True, f"{names[0]} and {names[1]} match the wrong way round: exchange left and right")]
    doubtful_rows, wrong_rows = (row_limit(limit, rig.camera.width) for limit in (DOUBTFUL_ROWS, WRONG_ROWS))
    if rows is not None and rows.significant:
        fatal = rows.size > wrong_rows
        doubtful = rows.size > doubtful_rows or rows.largest > 3 * doubtful_rows
        if fatal or (doubtful and not aligned):
            message = (
                f"the rows of {names[0]} and {names[1]} lie {rows.size:.1f} px apart (root mean square over the "
                f"image, fitted to {rows.points} points; up to {rows.largest:.1f} px in a corner): the pair is not "
                "rectified (--calib with --rectify always does that, and --align without a calibration)"
            )
            return [(fatal, message)]
    if shares[0] < LITTLE:
        nothing = shares[0] < HARDLY_ANY and rows is None and rig.camera.width >= SMALLEST
        return [(nothing, f"only {shares[0]:.0%} of {names[0]} and {names[1]} match: is it a pair?")]
    return []
