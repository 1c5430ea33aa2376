"""Raw pairs, which are rectified on the way in: products of rovers, and images with a calibration of raw cameras.

The rectified pair is written to the folder `rectified` of the results, as m3depth.rectify writes it, together with
them: a pair that cannot be used leaves nothing.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from m3depth.datasets.image_files import as_pair
from m3depth.datasets.rigs import NATECAM_NAME
from m3depth.prediction.options import PredictOptions
from m3depth.prediction.sources.pair_input import PairInput, ReadPair
from m3depth.rectification.checked import NEEDS_CALIB, rectified
from m3depth.rectification.files import labelled_camera_pose
from m3depth.rectification.options import RectifyOptions
from m3depth.rectification.placing import rectified_to_raw, rectified_to_rover
from m3depth.rectification.product_names import SUFFIXES, is_product, left_products, right_of
from m3depth.rectification.raw_image import RawImage, read_raw_pair
from marssim.base.calibration.orientation import common_orientation
from marssim.base.calibration.read_pair import (
    calibration_of_distorted_images,
    has_label,
    is_of_raw_cameras,
    labelled_pair,
    read_label,
    read_raw_calibration,
)

FOLDER = "rectified"  # in the folder of a pair's results


def find_products(folder: Path) -> list[tuple[Path, Path]]:
    """Return the left and right products in a folder, whose names say which belong together; empty if there are none.

    A broken product is among them, so that reading it says what is wrong.

    Raises:
        FileNotFoundError: A left product lacks its right one; the message names it.
    """
    products = [left for left in left_products(folder) if is_product(left)]
    products.sort(key=lambda left: SUFFIXES.index(left.suffix.lower()))
    lefts: dict[str, Path] = {}  # by their names without the end; the label beside a product is none of its own
    for left in [*filter(has_label, products), *products]:
        lefts.setdefault(left.stem, left)
    return [(lefts[name], right_of(lefts[name])) for name in sorted(lefts)]


def must_be_rectified(options: PredictOptions, left: Path) -> bool:
    """Return whether pairs are raw: as the flags say, or by the first left image and the calibration.

    Args:
        options: The command's flags.
        left: The first left image, or a video.
    """
    if options.rectify != "auto":
        return options.rectify == "always"
    if options.raw.align or is_product(left):
        return True
    if not options.calib or options.calib == (NATECAM_NAME,):
        return False
    try:
        if is_of_raw_cameras(options.calib):
            return True
        distorted = calibration_of_distorted_images(options.calib)
    except (FileNotFoundError, ValueError):  # reading the calibration reports it
        return False
    if distorted is not None:
        means = "the images are taken as rectified ones; if they are not, give --rectify always"
        print(f"note: {distorted} is of a camera with distortion, or one that is turned: {means}", file=sys.stderr)
    return False


@dataclass(frozen=True)
class RawPairs:
    """Rectifies pairs on the way in.

    Attributes:
        options: The flags of m3depth.rectify, without the images.
        keeps_geometry: Whether nothing but the rows of the right image changes, as there is no calibration of the raw
            cameras. Then a calibration of the images as they are holds for the rectified ones.
    """

    options: RectifyOptions
    keeps_geometry: bool

    @classmethod
    def from_options(cls, options: PredictOptions, left: Path) -> RawPairs:
        """Return what the flags of m3depth.predict ask for.

        Args:
            options: The command's flags.
            left: The first left image, or a video.

        Raises:
            ValueError: A flag is for rectified images, or there is no calibration.
        """
        keeps_geometry = options.raw.align and not options.calib and not _has_camera(left)
        if not (options.calib or keeps_geometry or is_product(left)):
            raise ValueError(
                "--rectify always needs the calibration of the raw cameras: give --calib; --align fits the rows "
                "without one"
            )
        for name in ("cx", "cy", "baseline"):
            if getattr(options, name) is not None and not keeps_geometry:
                raise ValueError(f"--{name} is of rectified images, and these are rectified here; leave it out")
        if options.calib == (NATECAM_NAME,):
            raise ValueError("--calib natecam is of rectified images; give a calibration of the raw cameras")
        if options.calib:
            read_raw_calibration(options.calib, options.raw.fisheye)  # what is wrong with it is wrong for all pairs
        elif options.raw.fisheye:
            raise ValueError(NEEDS_CALIB)
        flags = RectifyOptions(
            (), options.out, calib=options.calib, raw=options.raw, focal=options.focal, mask=options.mask,
            unchecked=options.unchecked,
        )  # fmt: skip
        return cls(flags, keeps_geometry)

    def named(self, pair: PairInput, out: Path) -> PairInput:
        """Return a raw pair with the files that its rectified images are written to.

        Args:
            pair: The pair, whose images are raw.
            out: The folder of all results.
        """
        left, right = (out / pair.name / FOLDER / f"{eye}.png" for eye in ("left", "right"))
        calibration = pair.calibration if self.keeps_geometry else None
        return replace(pair, left=left, right=right, raw=(pair.left, pair.right), calibration=calibration)

    def read(
        self, pair: PairInput, labels: tuple[str, str], images: tuple[np.ndarray, np.ndarray] | None = None
    ) -> ReadPair:
        """Rectify a pair.

        Args:
            pair: The pair.
            labels: What messages call its images.
            images: The images of a recording, uint8.

        Raises:
            FileNotFoundError, ImportError, ValueError: As of m3depth.rectify.
        """
        if images is None:
            left, right = read_raw_pair(*pair.given, check=not self.options.unchecked)
        else:
            paths = pair.given if pair.given[0] != pair.given[1] else map(Path, labels)
            left, right = (
                RawImage(path, image, np.ones(image.shape[:2], bool)) for path, image in zip(paths, images, strict=True)
            )
        checked = rectified(self.options, left, right)
        result = checked.pair
        if (calibration := result.calibration) is not None:
            pair = replace(pair, calibration=lambda width, height: calibration)
        if result.view is not None and result.cameras is not None:
            pair = replace(pair, raw_frame=rectified_to_raw(result.cameras, result.view.rotation))
        if (on_rover := labelled_camera_pose(result)) is not None:
            pair = replace(pair, on_rover=on_rover)
        first, second = as_pair(result.left, result.right, *labels)
        return ReadPair(pair, first, second, (result.left_valid, result.right_valid), checked)

    def placed(self, pair: PairInput) -> PairInput:
        """Return a pair with the frames that its calibration gives, without reading the images.

        Raises:
            FileNotFoundError, ValueError: The calibration cannot be read. One line that names the file.
        """
        if self.keeps_geometry:
            return pair
        if self.options.calib:
            cameras = read_raw_calibration(self.options.calib, self.options.raw.fisheye)
        else:
            cameras = labelled_pair([read_label(path) for path in pair.given], pair.given)
        rotation = common_orientation(cameras)
        pair = replace(pair, raw_frame=rectified_to_raw(cameras, rotation))
        on_rover = rectified_to_rover(cameras, rotation)
        return pair if on_rover is None else replace(pair, on_rover=on_rover)


def _has_camera(left: Path) -> bool:
    """Return whether a file is a product whose label has a camera model, or is broken, which reading it reports."""
    if not is_product(left):
        return False
    try:
        label = read_label(left)
    except ValueError:
        return True
    return label is not None and label.camera is not None
