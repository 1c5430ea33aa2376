"""The flags of m3depth.rectify."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

LARGEST = 16_384  # [px] side of a rectified image


@dataclass(frozen=True)
class RawOptions:
    """How raw images are rectified, by m3depth.rectify and by m3depth.predict."""

    align: bool = False
    """Fit the rows of raw images to matches with six terms: for a calibration that is nearly right, or for none.
    Without it, a constant row offset is taken out."""
    fisheye: bool = False
    """Take four coefficients of distortion in OpenCV's names for those of cv2.fisheye."""


@dataclass(frozen=True)
class RectifyOptions:
    """Rectify a raw stereo pair by its calibration, and report how far its rows lie apart."""

    images: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="LEFT [RIGHT]")]
    """Left and right image file. For products of Mars 2020 and MSL the left one alone is enough: its name tells the
    right one."""
    out: Path
    """Folder to write the results to."""
    calib: tuple[Path, ...] = ()
    """Calibration of the raw cameras: one file of the pair, or those of the left and of the right camera. Without it,
    the labels of the images."""
    raw: Annotated[RawOptions, tyro.conf.arg(name="")] = field(default_factory=RawOptions)
    """How the images are rectified."""
    focal: float | None = None
    """Focal length of the rectified images [px], above 0. Without it, the shortest one that leaves no empty border,
    between half of the lenses' own and all of it. With --align and no calibration, that of the given images: a turn of
    the cameras up or down is then taken out of the columns too."""
    size: tuple[int, int] | None = None
    """Width and height of the rectified images [px], 16 to 16384. Without it, those of the left image."""
    shift: float | None = None
    """Disparity [px] to take out of all pixels, -16384 to 16384, which rig.json gives back. Without it, one is chosen
    where the cameras are turned towards each other; 0 takes out none."""
    mask: tuple[Path, ...] = ()
    """Mask of the left raw image, or of both: an image file whose pixels of 0 are left out, such as those of the rover
    itself."""
    unchecked: bool = False
    """Write the result even where the pair shows that it is meaningless, and print a warning instead of an error."""

    def check(self) -> None:
        """Raise ValueError that names a flag that cannot be used."""
        if not 1 <= len(self.images) <= 2:
            raise ValueError(f"give a left and a right image, got {len(self.images)} files")
        if len(self.calib) > 2:
            raise ValueError(f"--calib {self.calib[2]}: a pair has two calibration files at most, got a third")
        if len(self.mask) > 2:
            raise ValueError(f"--mask {self.mask[2]}: a pair has two masks at most, got a third")
        if self.focal is not None and not (np.isfinite(self.focal) and self.focal > 0):
            raise ValueError(f"--focal must be positive, got {self.focal}")
        if self.size is not None and not all(16 <= side <= LARGEST for side in self.size):
            raise ValueError(f"--size must be 16 to {LARGEST} px, got {self.size[0]} {self.size[1]}")
        if self.shift is not None and not abs(self.shift) <= LARGEST:
            raise ValueError(f"--shift must be at most {LARGEST} px, got {self.shift}")
