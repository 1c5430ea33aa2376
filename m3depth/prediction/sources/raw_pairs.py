"""Raw pairs, which are rectified on the way in: products of rovers, and images with a calibration of raw cameras.

The rectified pair of each is written to the folder `rectified` of its results, as m3depth.rectify writes it. From there
on it is a pair like others, with its rig.json and its masks beside the images.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from tqdm import tqdm

from m3depth.datasets.image_files import read_pair
from m3depth.datasets.rigs import NATECAM_NAME
from m3depth.prediction.options import PredictOptions
from m3depth.rectification.checked import rectified
from m3depth.rectification.options import RectifyOptions
from m3depth.rectification.product_names import left_products, right_of
from m3depth.rectification.raw_image import RawImage, read_raw_pair
from marssim.base.calibration.read_pair import is_of_raw_cameras, read_label

FOLDER = "rectified"  # in the folder of a pair's results
PRODUCTS = (".img", ".vic", ".red", ".lbl", ".xml")  # ends of the names of products, and of their detached labels


def is_product(path: Path) -> bool:
    """Return whether a file is a product of a mission, with a label of PDS or VICAR."""
    return path.suffix.lower() in PRODUCTS and path.is_file() and read_label(path) is not None


def find_products(folder: Path) -> list[tuple[Path, Path]]:
    """Return the left and right products in a folder, whose names say which belong together; empty if there are none.

    Raises:
        FileNotFoundError: A left product lacks its right one; the message names it.
    """
    lefts: dict[str, Path] = {}  # by their names without the end; the label beside a product is none of its own
    for suffix in PRODUCTS:
        for left in left_products(folder):
            if left.suffix.lower() == suffix and left.stem not in lefts and is_product(left):
                lefts[left.stem] = left
    return [(lefts[name], right_of(lefts[name])) for name in sorted(lefts)]


def must_be_rectified(options: PredictOptions, left: Path) -> bool:
    """Return whether pairs are raw: as --rectify says, or by the first left image and the calibration.

    Args:
        options: The command's flags.
        left: The first left image, or a video.
    """
    if options.rectify != "auto":
        return options.rectify == "always"
    try:
        if is_product(left):
            return True
        return bool(options.calib) and options.calib != (NATECAM_NAME,) and is_of_raw_cameras(options.calib)
    except (FileNotFoundError, ValueError):  # who reads it reports it
        return False


@dataclass(frozen=True)
class RawPairs:
    """Rectifies pairs on the way in.

    Attributes:
        calib, mask, focal, unchecked: The flags of m3depth.rectify.
        single: Whether it is one pair, of which a picture of the rows is drawn and the summary printed.
    """

    calib: tuple[Path, ...]
    mask: tuple[Path, ...]
    focal: float | None
    unchecked: bool
    single: bool

    @classmethod
    def of(cls, options: PredictOptions, left: Path, single: bool) -> RawPairs:
        """Return what the flags of m3depth.predict ask for.

        Args:
            options: The command's flags.
            left: The first left image, or a video.
            single: Whether it is one pair.

        Raises:
            ValueError: A flag is for rectified images, or there is no calibration.
        """
        if not options.calib and not is_product(left):
            raise ValueError(
                "--rectify always needs the calibration of the raw cameras: give --calib; m3depth.rectify --align fits "
                "the rows without one"
            )
        for name in ("cx", "cy", "baseline"):
            if getattr(options, name) is not None:
                raise ValueError(f"--{name} is of rectified images, and these are rectified here; leave it out")
        if options.calib == (NATECAM_NAME,):
            raise ValueError("--calib natecam is of rectified images; give a calibration of the raw cameras")
        return cls(options.calib, options.mask, options.focal, options.unchecked, single)

    def read(
        self, raw: tuple[Path, Path], out: Path, images: tuple[np.ndarray, np.ndarray] | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Rectify a pair, write it, and return both images, uint8, grey or RGB.

        Args:
            raw: The raw images, or the videos that they are from.
            out: The folder to write the rectified pair to.
            images: The frames of videos, uint8.

        Raises:
            FileNotFoundError, ImportError, ValueError: As of m3depth.rectify.
        """
        options = RectifyOptions(raw, out, calib=self.calib, focal=self.focal, mask=self.mask, unchecked=self.unchecked)
        if images is None:
            left, right = read_raw_pair(*raw, check=not self.unchecked)
        else:
            left, right = (
                RawImage(path, image, np.ones(image.shape[:2], bool)) for path, image in zip(raw, images, strict=True)
            )
        result = rectified(options, left, right)
        for message in result.warnings:
            tqdm.write(f"warning: {message}", file=sys.stderr)
        result.write(out, with_picture=self.single)
        if self.single:
            print(f"{out}: {result.summary()}")
        return read_pair(*files_in(out))


def files_in(folder: Path) -> tuple[Path, Path]:
    """Return the images of a rectified pair in a folder."""
    return folder / "left.png", folder / "right.png"


def without_raw_flags(options: PredictOptions) -> PredictOptions:
    """Return the flags for the pairs once they are rectified: their calibration and masks lie beside them."""
    return replace(options, calib=(), mask=())
