"""Image files of stereo pairs."""

from __future__ import annotations

import warnings
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from m3depth.stereo.pairs import in_colour
from marssim.base.command.input_file import check_file
from marssim.base.files.decoding import decode
from marssim.base.files.pfm import decode_pfm
from marssim.base.files.png import MAGIC, is_whole

BRIGHT = 99.9  # percentile of a 16-bit pair that becomes white [%]; hot pixels then do not darken all others


def read_pair(left: Path, right: Path) -> tuple[np.ndarray, np.ndarray]:
    """Read two images as uint8 RGB (H, W, 3) or grey (H, W), both of the same kind; alpha is dropped.

    16-bit pairs are scaled by one factor for both images.

    Args:
        left: File of the left image.
        right: File of the right image.

    Raises:
        FileNotFoundError: A file is missing; the message names it.
        ValueError: A file is unreadable, or has another size or bit depth than its partner; the message names it.
    """
    return as_pair(read_image(left), read_image(right), str(left), str(right))


def as_pair(a: np.ndarray, b: np.ndarray, left: str, right: str) -> tuple[np.ndarray, np.ndarray]:
    """Return two images, uint8 or uint16, as read_pair does; `left` and `right` name them in messages."""
    if a.shape[:2] != b.shape[:2]:
        raise ValueError(
            f"{left} is {a.shape[1]} x {a.shape[0]}, {right} is {b.shape[1]} x {b.shape[0]}: "
            "both images of a rectified pair must have the same size"
        )
    if a.dtype != b.dtype:
        raise ValueError(
            f"{left} is {a.dtype}, {right} is {b.dtype}: both images of a pair must have 8 bits, or both 16"
        )
    a, b = in_eight_bits(a, b)
    if a.ndim != b.ndim:
        a, b = in_colour(a), in_colour(b)
    return np.ascontiguousarray(a), np.ascontiguousarray(b)


def in_eight_bits(*images: np.ndarray) -> list[np.ndarray]:
    """Return images as uint8, those of uint16 scaled by one factor; all have one of the two types, and any size."""
    if images[0].dtype == np.uint8:
        return [*images]
    white = max(1.0, *(float(np.percentile(image, BRIGHT)) for image in images))
    return [np.round(np.minimum(image * (255 / white), 255)).astype(np.uint8) for image in images]


def decode_image(data: bytes) -> np.ndarray | None:
    """Decode an image file without messages on stderr.

    Args:
        data: Bytes of the file.

    Returns:
        (H, W) or BGR (H, W, 3), of any type; None if the file cannot be decoded.
    """
    if data.startswith(MAGIC) and not is_whole(data):
        return None
    if data[:2] in (b"Pf", b"PF"):
        values = decode_pfm(data)
        return values[..., ::-1] if values is not None and values.ndim == 3 else values
    return decode(data, cv2.IMREAD_UNCHANGED)


def read_image(path: Path) -> np.ndarray:
    """Read an image as (H, W) or RGB (H, W, 3), uint8 or uint16."""
    check_file(path)
    image = decode_image(path.read_bytes())
    if image is None:
        raise ValueError(f"{path}: not a readable image")
    if image.dtype not in (np.uint8, np.uint16):
        raise ValueError(f"{path}: holds {image.dtype}; images must have 8 or 16 bits")
    if image.ndim == 3:
        image = image[..., 0] if image.shape[2] < 3 else image[..., 2::-1]  # BGR becomes RGB
    return image


def image_size(path: Path) -> tuple[int, int] | None:
    """Return width and height [px] by an image's header; None where it is broken or of an unusual type."""
    with (
        suppress(Exception),
        warnings.catch_warnings(),
    ):  # Pillow raises whatever it meets; reading the image reports it
        warnings.simplefilter("ignore")
        with Image.open(path) as image:
            return image.size
    return None


def read_scene_mask(path: Path, shape: tuple[int, int], image: str = "its image") -> np.ndarray:
    """Read the mask of an image, in which 0 leaves a pixel out.

    Args:
        path: Image file of 8 or 16 bits; in a mask of colours, black leaves a pixel out.
        shape: Height and width of the image [px].
        image: What the message calls it.

    Returns:
        (H, W) bool, where the image shows the scene.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The file is no image, or of another size. One line that names it.
    """
    check_file(path, "mask")
    pixels = read_image(path)
    if pixels.shape[:2] != shape:
        size = f"{pixels.shape[1]} x {pixels.shape[0]}"
        raise ValueError(f"{path}: is {size}, {image} is {shape[1]} x {shape[0]}: a mask has the image's size")
    return np.asarray(pixels.any(axis=2) if pixels.ndim == 3 else pixels > 0)
