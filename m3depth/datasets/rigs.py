"""The camera of a dataset's pairs: from a file beside them, or from flags for all of them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path

from m3depth.datasets.config import DataConfig
from m3depth.datasets.oaisys import oaisys_rig
from m3depth.datasets.pair_files import CalibrationFinder, CalibrationReader
from marssim.base.calibration.rectified import Calibration, read_calibration
from marssim.base.camera import NARROWEST_BASELINE, NATECAM, WIDEST_BASELINE
from marssim.base.files.json_file import DatasetError

NATECAM_NAME = Path("natecam")
SAME_SHAPE, OTHER_SCALE = 0.03, 0.1  # shares by which the shapes and the sizes of two images differ or not


class CommonSize:
    """The size of the first images that are read with a focal length [px]. Others may be cut to another shape.

    Args:
        source: What gives the focal length, for messages: a flag, or a file.
    """

    def __init__(self, source: str) -> None:
        self.source = source
        self.first: tuple[Path, int, int] | None = None

    def check(self, left: Path, width: int, height: int) -> None:
        """Raise DatasetError, which names an image, if it is the same view as the first one at another scale."""
        if self.first is None:
            self.first = left, width, height
        other, first_width, first_height = self.first
        scale, shape = width / first_width, (width / height) / (first_width / first_height)
        if abs(shape - 1) < SAME_SHAPE and abs(scale - 1) > OTHER_SCALE:
            raise DatasetError(
                f"{left}: is {width} x {height} px, and {other} {first_width} x {first_height}: {self.source} is in "
                "pixels of one size; resize the images, or give each size a folder with a calib.txt of its own"
            )


@dataclass(frozen=True)
class FileRig:
    """Reads a calibration file, and checks it against the size of the images.

    Attributes:
        file: The calibration file.
        left: The left image of the pair.
        is_given: Whether a flag names the file; messages do not ask for one then.
        common: The size of the first images of all for which it is given.
    """

    file: Path
    left: Path
    is_given: bool = False
    common: CommonSize | None = None

    def __call__(self, width: int, height: int) -> Calibration:
        """Return the calibration of images of a size [px]. Raises DatasetError that names the file."""
        try:
            calibration = read_calibration(self.file, image=self.left)
        except (ValueError, FileNotFoundError) as error:
            instead = "" if self.is_given else "; give --calib, or --focal and --baseline, instead"
            raise DatasetError(f"{error}{instead}") from None
        size, baseline = calibration.size, calibration.baseline
        if size is not None and size != (width, height):
            raise DatasetError(f"{self.file}: is for {size[0]} x {size[1]} px, {self.left} is {width} x {height}")
        if size is None and self.common is not None:
            self.common.check(self.left, width, height)
        if baseline <= 0:
            raise DatasetError(f"{self.file}: the baseline is {baseline:g} m; are left and right exchanged?")
        if baseline < NARROWEST_BASELINE:
            raise DatasetError(
                f"{self.file}: the baseline is {baseline:g} m; is it in the unit of the format, millimetres in "
                "Middlebury's and metres in others?"
            )
        if baseline > WIDEST_BASELINE:
            raise DatasetError(
                f"{self.file}: the baseline is {baseline:g} m, over {WIDEST_BASELINE:g}; is it in millimetres?"
            )
        return calibration


def given_rig(config: DataConfig) -> CalibrationFinder | None:
    """Return the calibration that the flags give for all pairs; None if they give none.

    Raises:
        DatasetError: The calibration file is missing or does not fit; the message is one line.
    """
    if config.focal is not None and config.baseline is not None:
        focal, baseline, flag = config.focal, config.baseline, CommonSize("--focal")
        return lambda calib, left: partial(_centred, focal, baseline, flag, left)
    if config.calib == NATECAM_NAME:
        return lambda calib, left: natecam
    if config.calib is None:
        return None
    path = config.calib
    if not path.is_file():
        raise DatasetError(f"{path}: no such calibration file")
    if (sensors := oaisys_rig(path, config)) is None:
        size = CommonSize(f"the focal length of {path}")
        return lambda calib, left: FileRig(path, left, is_given=True, common=size)
    rig: Calibration = sensors
    return lambda calib, left: SensorRig(path, left, rig)


def rigs_of_files() -> CalibrationFinder:
    """Return what reads the calibration file of a pair, of which one may serve all."""
    sizes: dict[Path, CommonSize] = {}

    def rig(calib: Path, left: Path) -> CalibrationReader:
        size = sizes.setdefault(calib, CommonSize(f"the focal length of {calib}"))
        return FileRig(calib, left, common=size)

    return rig


def _centred(focal: float, baseline: float, common: CommonSize, left: Path, width: int, height: int) -> Calibration:
    """Return the calibration of images of a size [px] whose principal point is their middle."""
    common.check(left, width, height)
    return Calibration(focal, focal, (width - 1) / 2, (height - 1) / 2, baseline)


@dataclass(frozen=True)
class SensorRig:
    """Gives the rig of the sensors of an OAISYS configuration, and checks it against the size of the images.

    Attributes:
        file: The configuration.
        left: The left image of the pair.
        rig: What the configuration says.
    """

    file: Path
    left: Path
    rig: Calibration

    def __call__(self, width: int, height: int) -> Calibration:
        """Return the calibration of images of a size [px]. Raises DatasetError that names the file."""
        size = self.rig.size
        if size != (width, height):
            expected = "images of another size" if size is None else f"{size[0]} x {size[1]} px"
            raise DatasetError(f"{self.file}: is for {expected}, {self.left} is {width} x {height}")
        return self.rig


def natecam(width: int, height: int) -> Calibration:
    """Return Zhurong's camera, as the paper gives it, for images of any size of its square field of view.

    Args:
        width: Width of the images [px].
        height: Height of the images [px], the same.
    """
    if width != height:
        raise DatasetError(f"--calib natecam: the images must be square, these are {width} x {height}")
    c = NATECAM.camera.resized(width, height)
    return Calibration(c.fx, c.fy, c.cx, c.cy, NATECAM.baseline)
