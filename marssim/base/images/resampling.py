"""Where the pixels of a rectified image come from in the raw one, and the images themselves."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from marssim.base.calibration.cameras import PosedCamera
from marssim.base.calibration.orientation import directions
from marssim.base.camera import PinholeCamera

Source = Callable[[np.ndarray], np.ndarray]
"""Returns the places (..., 2) in a raw image [px] of places (..., 2) in a rectified one; NaN where there is none."""

REACH = 4  # [px] from a pixel without data up to which Lanczos over 8 x 8 pixels draws from it
OUTSIDE = -1e4  # [px] place of pixels that show nothing


def rectifying(camera: PosedCamera, ideal: PinholeCamera, rotation: np.ndarray) -> Source:
    """Return where the pixels of a rectified camera lie in the images of a camera.

    Args:
        camera: The camera as it was built.
        ideal: The rectified camera.
        rotation: (3, 3) rig frame to the rectified camera's frame.
    """
    return lambda pixels: camera.project_directions(directions(ideal, rotation, pixels))


def unchanged(pixels: np.ndarray) -> np.ndarray:
    """Return the places themselves: the Source of an image that is rectified as it is."""
    return np.asarray(pixels, dtype=float)


def pixel_grid(width: int, height: int) -> np.ndarray:
    """Return (H, W, 2) the column and row of each pixel."""
    return np.stack(np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float)), axis=-1)


def resample(
    pixels: np.ndarray, valid: np.ndarray, source: Source, size: tuple[int, int], reduction: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """Return a rectified image, by Lanczos, and where it shows what the raw one shows.

    Args:
        pixels: (H, W) or (H, W, 3) raw image, uint8 or uint16.
        valid: (H, W) bool.
        source: Where its pixels come from.
        size: Width and height of the rectified image [px].
        reduction: How many pixels of the raw image make one of the rectified image, at its middle; over 1, the raw
            image is blurred, so that nothing is aliased.

    Returns:
        An image of the same type, 0 where there is nothing, and (H', W') bool.
    """
    places = source(pixel_grid(*size))
    height, width = valid.shape
    with np.errstate(invalid="ignore"):
        inside = np.asarray(((places >= 0) & (places <= (width - 1, height - 1))).all(axis=-1))
    places = np.where(inside[..., None], places, OUTSIDE).astype(np.float32)
    columns, rows = places[..., 0], places[..., 1]
    values: np.ndarray = pixels.astype(np.float32)
    reach = REACH
    if reduction > 1:
        deviation = 0.5 * np.sqrt(reduction**2 - 1)
        values = cv2.GaussianBlur(values, (0, 0), deviation)
        reach += int(np.ceil(3 * deviation))
    # OpenCV's cubic interpolation moves what it shows by up to 0.05 px
    image = cv2.remap(values, columns, rows, cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REFLECT_101)
    near = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    usable = cv2.erode(valid.astype(np.uint8), near, borderType=cv2.BORDER_REPLICATE)
    shown = inside & (cv2.remap(usable, columns, rows, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE) > 0)
    image = np.clip(np.round(image), 0, np.iinfo(pixels.dtype).max).astype(pixels.dtype)
    image[~shown] = 0
    return image, shown
