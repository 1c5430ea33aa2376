"""Raw images of a pair: of any image format, or products of missions with their labels."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from m3depth.datasets.image_files import read_image, read_scene_mask
from m3depth.rectification.product_names import is_product, label_beside
from m3depth.rectification.products import read_product
from m3depth.stereo.pairs import LARGEST_SIDE, in_colour, in_grey
from marssim.base.calibration.product_label import ProductLabel, check_labels
from marssim.base.calibration.read_pair import read_label
from marssim.base.command.input_file import check_file

PERCENTILES = (0.5, 99.5)  # of brightness that become black and white for matching


@dataclass(frozen=True)
class RawImage:
    """A raw image.

    Attributes:
        path: Its file.
        pixels: (H, W) or RGB (H, W, 3), uint8, uint16 or float32.
        valid: (H, W) bool, where it holds data of the scene.
        label: The label of a product; None for other images.
    """

    path: Path
    pixels: np.ndarray
    valid: np.ndarray
    label: ProductLabel | None = None

    @property
    def size(self) -> tuple[int, int]:
        """Width and height [px]."""
        return self.pixels.shape[1], self.pixels.shape[0]


def read_raw_pair(left: Path, right: Path, check: bool = True) -> tuple[RawImage, RawImage]:
    """Read both images of a pair, which come in one kind of pixels.

    Args:
        left: File of the left image.
        right: File of the right image.
        check: Whether to refuse products whose labels say that they are no pair.

    Raises:
        FileNotFoundError: A file is missing.
        ImportError: A product without pdr.
        ValueError: A file is no image, or the two are no pair. One line that names them.
    """
    for path in (left, right):
        check_file(path, "image")
    labels = read_label(left), read_label(right)
    if check and labels[0] is not None and labels[1] is not None:
        check_labels(labels[0], labels[1], (left, right))
    a, b = (_read(path, label) for path, label in zip((left, right), labels))
    for path, image in ((left, a), (right, b)):
        if max(image.size) > LARGEST_SIDE:
            size = f"{image.size[0]} x {image.size[1]}"
            raise ValueError(f"{path}: is {size}: images with sides of at most {LARGEST_SIDE} px can be rectified")
    if a.pixels.dtype != b.pixels.dtype:
        raise ValueError(
            f"{left} is {a.pixels.dtype}, {right} is {b.pixels.dtype}: both images of a pair must be of one kind"
        )
    if a.pixels.ndim != b.pixels.ndim:
        a, b = (replace(image, pixels=in_colour(image.pixels)) for image in (a, b))
    if a.pixels.dtype == np.float32:
        a, b = _in_16_bits(a, b)
    return a, b


def masked(image: RawImage, mask: Path) -> RawImage:
    """Return an image without what a mask leaves out, such as the rover itself.

    Args:
        image: The image.
        mask: Image file of the same size; 0 leaves a pixel out (see read_scene_mask).

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The file is no image, or of another size.
    """
    height, width = image.valid.shape
    return replace(image, valid=image.valid & read_scene_mask(mask, (height, width), str(image.path)))


def for_matching(pixels: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Return an image as (H, W) uint8 with full contrast. Grey levels of the two eyes need not agree."""
    grey = in_grey(pixels.astype(np.float32))
    shown = grey[valid]
    low, high = np.percentile(shown, PERCENTILES) if shown.size else (0.0, 1.0)
    return np.clip((grey - low) * (255 / max(high - low, 1e-12)), 0, 255).astype(np.uint8)


def _read(path: Path, label: ProductLabel | None) -> RawImage:
    if label is None:
        _check_label(path)
        pixels = read_image(path)
        return RawImage(path, np.ascontiguousarray(pixels), np.ones(pixels.shape[:2], bool))
    pixels, valid = read_product(path, label)
    return RawImage(path, pixels, valid, label)


def _check_label(path: Path) -> None:
    """Raise ValueError for a product without a label, which a cut file may have lost."""
    if not is_product(path):
        return
    if (label := label_beside(path)) is not None:
        raise ValueError(f"{path}: has no label of its own; give the label beside it, {label.name}")
    raise ValueError(
        f"{path}: does not begin with a label of PDS or VICAR: is it whole? It has {path.stat().st_size} bytes"
    )


def _in_16_bits(a: RawImage, b: RawImage) -> tuple[RawImage, RawImage]:
    """Return a pair of float32 as uint16, both with one black and one white."""
    values = np.concatenate([image.pixels[image.valid].ravel() for image in (a, b)])
    low, high = (float(values.min()), float(values.max())) if values.size else (0.0, 1.0)
    scale = 65000 / max(high - low, 1e-30)
    left, right = (
        replace(image, pixels=np.clip((image.pixels - low) * scale, 0, 65535).astype(np.uint16)) for image in (a, b)
    )
    return left, right
