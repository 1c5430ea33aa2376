"""A pair as methods match it: the right image is moved to the left, its rows are aligned, and masks go with it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from m3depth.prediction.common_disparity import taken_out
from m3depth.prediction.masks import moved_mask, seen_by_mask, without_upper_margin
from m3depth.stereo.prediction import Prediction
from m3depth.stereo.rows import RowFit, aligned_right
from marssim.base.calibration.rectified import Calibration, align_right
from marssim.base.camera import StereoRig


@dataclass(frozen=True)
class MatchablePair:
    """A pair as methods match it.

    Attributes:
        left, right: (H, W) or (H, W, 3) uint8, rectified; the right one is moved, so that nothing has a negative
            disparity.
        rig: The cameras of these images.
        common: Common disparity that stays out while the pair is matched [px].
        left_valid, right_valid: (H, W) bool, where the images show the scene; None is everywhere. The rows of the right
            one are aligned, and its columns are not moved.
        moved: By how much the right image was moved to the left [px].
    """

    left: np.ndarray
    right: np.ndarray
    rig: StereoRig
    common: float = 0.0
    left_valid: np.ndarray | None = None
    right_valid: np.ndarray | None = None
    moved: float = 0.0

    @classmethod
    def from_images(
        cls,
        left: np.ndarray,
        right: np.ndarray,
        calibration: Calibration,
        valid: tuple[np.ndarray | None, np.ndarray | None] = (None, None),
    ) -> Self:
        """Make the pair: a small difference of the eyes' principal points is taken out of the right image.

        A large one, as of cameras that are turned towards each other, stays out, as `common`.

        Args:
            left, right: The images as they were given, (H, W) or (H, W, 3) uint8.
            calibration: Of these images.
            valid: Where each of them shows the scene, (H, W) bool; None for everywhere.
        """
        height, width = left.shape[:2]
        common = taken_out(calibration.shift, left, right, valid)
        moved = calibration.shift - common
        return cls(left, align_right(right, moved), calibration.rig(width, height), common, *valid, moved)

    def with_aligned_rows(self, fit: RowFit) -> Self:
        """Return the pair without a misalignment of its rows.

        Args:
            fit: The misalignment.
        """
        valid = self.right_valid
        if valid is not None:
            valid = aligned_right(valid.astype(np.uint8) * 255, self.rig, fit) > 127
        return replace(self, right=aligned_right(self.right, self.rig, fit), right_valid=valid)

    def without_upper_margins(self) -> Self:
        """Return the pair with images in which no upper margin parts the sky from the border. The masks stay."""
        moved = None if self.right_valid is None else moved_mask(self.right_valid, self.moved)
        left = without_upper_margin(self.left, self.left_valid)
        return replace(self, left=left, right=without_upper_margin(self.right, moved))

    @property
    def shown(self) -> np.ndarray:
        """The pixels that the left image shows, (H, W) bool."""
        return np.ones(self.left.shape[:2], bool) if self.left_valid is None else self.left_valid

    def matched_within(self, prediction: Prediction) -> np.ndarray:
        """Return the pixels that the left image shows, and the right one at their match, (H, W) bool.

        Args:
            prediction: The maps of this pair, without the common disparity.
        """
        if self.right_valid is None:
            return self.shown
        return self.shown & seen_by_mask(prediction, self.right_valid, self.moved)
