"""Pairs without true depth, found by the patterns of their images."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from m3depth.datasets.config import DataConfig
from m3depth.datasets.folders import partners
from m3depth.datasets.image_files import read_pair
from m3depth.datasets.pair_files import CalibrationFinder, CalibrationReader
from m3depth.datasets.rigs import FileRig, given_rig
from m3depth.prediction.masks import is_valid_mask
from marssim.base.calibration.rectified import align_right
from marssim.base.camera import StereoRig
from marssim.base.files.json_file import DatasetError


def are_without_truth(config: DataConfig) -> bool:
    """Return whether the flags name images and no maps."""
    named = config.left is not None and config.right is not None
    return named and config.format in ("auto", "folder") and config.disparity is None and config.depth is None


@dataclass(frozen=True)
class ImagePair:
    """The files of a pair, and what reads its calibration."""

    name: str
    left: Path
    right: Path
    calibration: CalibrationReader

    def read(self) -> tuple[np.ndarray, np.ndarray, StereoRig]:
        """Return both images, uint8, the right one without the difference of the eyes' principal points, and the rig.

        Raises:
            DatasetError: A file cannot be used; the message names it.
        """
        try:
            left, right = read_pair(self.left, self.right)
        except ValueError as error:
            raise DatasetError(str(error)) from None
        calibration = self.calibration(left.shape[1], left.shape[0])
        return left, align_right(right, calibration.shift), calibration.rig(left.shape[1], left.shape[0])


def image_pairs(root: Path, config: DataConfig) -> list[ImagePair]:
    """Return the pairs of a folder.

    Args:
        root: The folder that the patterns start from.
        config: The patterns, and the calibration.

    Raises:
        DatasetError: There are none, an image has no partner, or nothing gives the calibration; the message names it.
    """
    if not root.is_dir():
        raise DatasetError(f"{root}: no such folder")
    for name in ("unit", "normal", "normal_frame", "normals", "resize", "depth_range"):
        if name in config.changed_fields():
            raise DatasetError(f"--{name.replace('_', '-')} is for pairs with true depth; give --disparity or --depth")
    rigs = given_rig(config)
    if rigs is None and not (root / "calib.txt").is_file():
        raise DatasetError(f"{root}: pairs need --calib, or --focal and --baseline, or {root / 'calib.txt'}")
    return list(_pairs(root, config, rigs or FileRig))


def _pairs(root: Path, config: DataConfig, rigs: CalibrationFinder) -> Iterator[ImagePair]:
    assert config.left is not None and config.right is not None
    for left, right in partners(root, (config.left, config.right), is_valid_mask):
        name = left.relative_to(root).with_suffix("").as_posix()
        yield ImagePair(name, left, right, rigs(root / "calib.txt", left))
