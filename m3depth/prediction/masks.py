"""Pixels of which a prediction may say nothing, and how it says so: masks, disagreement of the eyes, low confidence."""

from __future__ import annotations

from dataclasses import replace
from glob import escape
from pathlib import Path

import numpy as np

from m3depth.datasets.image_files import read_scene_mask
from m3depth.stereo.prediction import Prediction
from marssim.base.calibration.rectified import align_right

VALID = "_valid"  # ends the name of the mask that m3depth.rectify writes beside an image


def is_valid_mask(path: Path) -> bool:
    """Return whether a file is the mask of an image beside it."""
    if not path.stem.endswith(VALID):
        return False
    stem = path.stem.removesuffix(VALID)
    return any(file.stem == stem for file in path.parent.glob(f"{escape(stem)}.*"))


def valid_mask(image: Path) -> Path:
    """Return where the mask of an image lies, if there is one."""
    return image.with_name(f"{image.stem}{VALID}.png")


def read_valid(image: Path | None, mask: Path | None, shape: tuple[int, int]) -> np.ndarray | None:
    """Return where an image shows the scene, (H, W) bool; None without a mask.

    Args:
        image: The image, whose NAME_valid.png beside it is read if there is one.
        mask: A mask of the user for all images.
        shape: Height and width of the image [px].

    Raises:
        FileNotFoundError: The mask is missing.
        ValueError: A mask is unreadable or has another size than the image; the message names it.
    """
    beside = None if image is None else valid_mask(image)
    valid = None
    for path in (mask, beside if beside is not None and beside.is_file() else None):
        if path is None:
            continue
        shown = read_scene_mask(path, shape)
        valid = shown if valid is None else valid & shown
    return valid


def moved_mask(valid: np.ndarray, shift: float) -> np.ndarray:
    """Return the mask (H, W) of a right image that is moved to the left by a shift [px]."""
    return align_right(valid.astype(np.uint8) * 255, shift) > 127


def seen_by_mask(prediction: Prediction, right_valid: np.ndarray, shift: float = 0.0) -> np.ndarray:
    """Return where the right image shows the scene at the match of a left pixel, (H, W) bool.

    Pixels without a finite disparity, and those whose match lies beyond the border, have no match to judge: True.

    Args:
        prediction: The maps of the pair as it was matched.
        right_valid: (H, W) bool of the right image as it was given.
        shift: By how much the right image was then moved to the left [px].
    """
    moved = moved_mask(right_valid, shift)
    width = moved.shape[1]
    with np.errstate(invalid="ignore"):
        column = np.arange(width) - prediction.disparity
        inside = (column >= max(0.0, -shift)) & (column <= width - 1)
    nearest = np.round(np.where(inside, column, 0)).astype(int)
    return ~inside | np.take_along_axis(moved, nearest, axis=1)


def without_upper_margin(image: np.ndarray, valid: np.ndarray | None) -> np.ndarray:
    """Return an image whose upper margin, where a mask is black from the border on, repeats the pixel below it.

    Sky is connected with the upper border (m3depth.stereo.sky), so below a margin of another colour it would be lost.

    Args:
        image: (H, W) or (H, W, 3).
        valid: (H, W) bool, where the image shows the scene; None is everywhere.
    """
    if valid is None or valid[0].all():
        return image
    row = np.maximum(np.arange(len(image))[:, None], valid.argmax(axis=0))
    return np.take_along_axis(image, row.reshape(*row.shape, *(1,) * (image.ndim - 2)), axis=0)


def without_sky_normals(prediction: Prediction) -> Prediction:
    """Return the prediction with normals set to 0, which means none, where depth is not finite."""
    if prediction.normal is None:
        return prediction
    normal = np.where(np.isfinite(prediction.depth)[..., None], prediction.normal, np.float32(0))
    return replace(prediction, normal=normal)


def unknown_where(prediction: Prediction, unknown: np.ndarray) -> Prediction:
    """Return the prediction with some pixels unknown: depth and disparity NaN, normal and confidence 0.

    Args:
        prediction: The maps.
        unknown: (H, W) bool.
    """
    if not unknown.any():
        return prediction
    nan, zero = np.float32(np.nan), np.float32(0)
    normal = prediction.normal
    return replace(
        prediction,
        depth=np.where(unknown, nan, prediction.depth),
        disparity=np.where(unknown, nan, prediction.disparity),
        normal=None if normal is None else np.where(unknown[..., None], zero, normal),
        confidence=np.where(unknown, zero, prediction.confidence),
    )


def unmeasured(prediction: Prediction, least: float | None = None) -> np.ndarray:
    """Return the pixels with depth that the method itself calls unknown, or of which it is not sure: (H, W) bool.

    A confidence of 0 means unknown: classical methods fill pixels without a match from their neighbours.

    Args:
        prediction: The maps.
        least: Least confidence of a pixel with depth; None: above 0.
    """
    with np.errstate(invalid="ignore"):
        low = ~(prediction.confidence > 0)
        if least is not None:
            low |= ~(prediction.confidence >= least)
    return np.asarray(np.isfinite(prediction.depth) & low)
