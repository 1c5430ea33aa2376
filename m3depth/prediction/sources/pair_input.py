"""A pair as the flags name it, and as it is once its images are read."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from m3depth.datasets.pair_files import CalibrationReader
from m3depth.rectification.checked import CheckedPair


@dataclass(frozen=True)
class PairInput:
    """One pair.

    Attributes:
        name: Path of its results below --out.
        left, right: The images, or the recordings that they are in.
        calibration: Reads its own calibration; None if the flags give it.
        number: Its place in the order of the pairs, or its number in a recording.
        sample: sample.json of a dataset, which may hold the pose of the camera.
        pose: (4, 4) left camera to the world of --poses or of a bag.
        on_rover: (4, 4) left camera to rover, where a bag or the label of a product says so.
        raw: The raw images, or the recordings that they are in, of a pair that is rectified here; `left` and `right`
            are then the files that the rectified ones are written to.
        raw_frame: (4, 4) rectified left camera to the raw one, of a raw pair that is read or comes from a bag.
    """

    name: str
    left: Path
    right: Path
    calibration: CalibrationReader | None = None
    number: int = 0
    sample: Path | None = None
    pose: np.ndarray | None = None
    on_rover: np.ndarray | None = None
    raw: tuple[Path, Path] | None = None
    raw_frame: np.ndarray | None = None

    @property
    def given(self) -> tuple[Path, Path]:
        """The images as the user has them."""
        return (self.left, self.right) if self.raw is None else self.raw

    @property
    def group(self) -> str:
        """Scene of a pair of a dataset; pairs of one scene have one world."""
        return "" if self.sample is None else self.name.rpartition("/")[0]


@dataclass(frozen=True)
class ReadPair:
    """The images of a pair, and what comes with them.

    Attributes:
        pair: The pair; a raw one has now what its rectification gives.
        left, right: The images, (H, W) or (H, W, 3) uint8. Those of a raw pair are rectified.
        valid: Where they show the scene, (H, W) bool each, or None, beside what masks say.
        rectified: What is to be written of a raw pair.
    """

    pair: PairInput
    left: np.ndarray
    right: np.ndarray
    valid: tuple[np.ndarray | None, np.ndarray | None] = (None, None)
    rectified: CheckedPair | None = None
