"""Pairs without true depth, found by the patterns of their images."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from m3depth.checked_inference import inferred
from m3depth.datasets.config import DataConfig
from m3depth.datasets.folders import partners, warn_of_lone_rights
from m3depth.datasets.image_files import image_size, read_pair
from m3depth.datasets.open import sensors_are_named
from m3depth.datasets.pair_files import CalibrationReader
from m3depth.datasets.rigs import FileRig, given_rig
from m3depth.estimator import Estimator
from m3depth.prediction.common_disparity import nearest_without
from m3depth.prediction.masks import is_valid_mask, read_valid, valid_mask
from m3depth.prediction.matchable import MatchablePair
from m3depth.prediction.settings import Infer
from m3depth.rectification.files import RIG_FILE, rig_beside
from m3depth.stereo.pairs import NEAREST
from m3depth.stereo.rows import row_misalignment
from m3depth.wrapped_estimators import takes_setting
from marssim.base.files.json_file import DatasetError


def are_without_truth(root: Path, config: DataConfig) -> bool:
    """Return whether the flags name images in a folder and no maps."""
    named = config.left is not None and config.right is not None
    if named and config.format == "auto" and sensors_are_named(root, config.left, config.right):
        return False
    return named and config.format in ("auto", "folder") and config.disparity is None and config.depth is None


class PairImages(MatchablePair):
    """A pair as m3depth.predict matches it, whose rows are aligned on demand."""

    def aligned(self) -> PairImages:
        """Return the pair with a right image whose rows do not lie significantly apart from those of the left one."""
        fit = row_misalignment(self.left, self.right, self.rig)
        return self.with_aligned_rows(fit) if fit is not None and fit.significant else self

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
        """Return the images, the rig, and the masks NAME_valid.png that lie beside the images.

        Raises:
            DatasetError: A file cannot be used; the message names it.
        """
        try:
            left, right = read_pair(self.left, self.right)
            height, width = left.shape[:2]
            left_valid, right_valid = (read_valid(file, None, (height, width)) for file in (self.left, self.right))
        except ValueError as error:
            raise DatasetError(str(error)) from None
        return PairImages.from_images(left, right, self.calibration(width, height), (left_valid, right_valid))

    @property
    def files(self) -> list[Path]:
        """The images, and the masks beside them."""
        masks = [valid_mask(image) for image in (self.left, self.right)]
        return [self.left, self.right, *(mask for mask in masks if mask.is_file())]


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
    warn_of_lone_rights(root, config.left, config.right, is_valid_mask)
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
