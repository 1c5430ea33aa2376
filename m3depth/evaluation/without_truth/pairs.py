"""Pairs without true depth, found by the patterns of their images."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from m3depth.datasets.config import DataConfig
from m3depth.datasets.folders import partners
from m3depth.datasets.image_files import image_size, read_pair
from m3depth.datasets.pair_files import CalibrationReader
from m3depth.datasets.rigs import FileRig, given_rig
from m3depth.estimator import Estimator, inferred
from m3depth.holes import takes_setting
from m3depth.prediction.common_disparity import nearest_without, taken_out
from m3depth.prediction.masks import is_valid_mask
from m3depth.prediction.settings import Infer
from m3depth.rectification.files import RIG_FILE, rig_beside
from m3depth.stereo.pairs import NEAREST
from m3depth.stereo.rows import align_rows
from marssim.base.calibration.rectified import align_right
from marssim.base.camera import StereoRig
from marssim.base.files.json_file import DatasetError


def are_without_truth(config: DataConfig) -> bool:
    """Return whether the flags name images and no maps."""
    named = config.left is not None and config.right is not None
    return named and config.format in ("auto", "folder") and config.disparity is None and config.depth is None


@dataclass(frozen=True)
class PairImages:
    """A pair as the methods see it.

    Attributes:
        left, right: (H, W) or (H, W, 3) uint8, rectified.
        rig: The cameras of these images.
        common: Common disparity that stays out while the pair is matched [px].
    """

    left: np.ndarray
    right: np.ndarray
    rig: StereoRig
    common: float = 0.0

    def with_aligned_rows(self) -> PairImages:
        """Return the pair with a right image whose rows do not lie significantly apart from those of the left one."""
        return replace(self, right=align_rows(self.left, self.right, self.rig)[0])

    def infer(self, method: Estimator) -> Infer:
        """Return what predicts this pair, or its mirrored one, by a method.

        The method looks for disparities as large as those of its nearest depth less the common one. What it returns
        lacks the common disparity, which `given_back` gives back.
        """
        if not (self.common and takes_setting(method, "nearest")):
            return partial(inferred, method)
        return partial(inferred, method, nearest=nearest_without(NEAREST, self.rig, self.common))


@dataclass(frozen=True)
class ImagePair:
    """The files of a pair, and what reads its calibration."""

    name: str
    left: Path
    right: Path
    calibration: CalibrationReader

    def read(self) -> PairImages:
        """Return the images and the rig. A small difference of the eyes' principal points is taken out of the right
        image; a large one, as of cameras that are turned towards each other, stays out as in m3depth.predict.

        Raises:
            DatasetError: A file cannot be used; the message names it.
        """
        try:
            left, right = read_pair(self.left, self.right)
        except ValueError as error:
            raise DatasetError(str(error)) from None
        height, width = left.shape[:2]
        calibration = self.calibration(width, height)
        common = taken_out(calibration.shift, width)
        return PairImages(left, align_right(right, calibration.shift - common), calibration.rig(width, height), common)


def image_pairs(root: Path, config: DataConfig) -> list[ImagePair]:
    """Return the pairs of a folder.

    Args:
        root: The folder that the patterns start from.
        config: The patterns, and the calibration.

    Raises:
        DatasetError: There are none, an image has no partner, or a pair has no calibration or one of another size; the
            message names it.
    """
    if not root.is_dir():
        raise DatasetError(f"{root}: no such folder")
    for name in ("unit", "normal", "normal_frame", "normals", "resize", "depth_range"):
        if name in config.changed_fields():
            raise DatasetError(f"--{name.replace('_', '-')} is for pairs with true depth; give --disparity or --depth")
    pairs = list(_pairs(root, config))
    for pair in pairs:  # what does not fit is said before hours of scoring, not after
        if (size := image_size(pair.left)) is not None:
            pair.calibration(*size)
    return pairs


def calibration_files(pairs: Sequence[ImagePair]) -> list[Path]:
    """Return the calibration files of the pairs, each once."""
    return list(dict.fromkeys(pair.calibration.file for pair in pairs if isinstance(pair.calibration, FileRig)))


def _pairs(root: Path, config: DataConfig) -> Iterator[ImagePair]:
    assert config.left is not None and config.right is not None
    rigs = given_rig(config) or partial(_own_rig, root)
    for left, right in partners(root, (config.left, config.right), is_valid_mask):
        name = left.relative_to(root).with_suffix("").as_posix()
        yield ImagePair(name, left, right, rigs(root / "calib.txt", left))


def _own_rig(root: Path, calib: Path, left: Path) -> CalibrationReader:
    """Return the calibration of a pair that no flag gives: of the folder, or the rig file of m3depth.rectify."""
    for file in (calib, rig_beside(left)):
        if file.is_file():
            return FileRig(file, left)
    raise DatasetError(
        f"{root}: pairs need --calib, or --focal and --baseline, or {calib}, or a {RIG_FILE} beside each: "
        f"{left.parent} has none"
    )
