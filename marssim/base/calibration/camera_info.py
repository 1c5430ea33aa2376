"""ROS's CameraInfo as text: the YAML of camera_calibration, and the output of `rostopic echo` and `ros2 topic echo`.

It reads only plain keys with numbers, by regular expressions; it loads no YAML.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from marssim.base.calibration import fields
from marssim.base.calibration.cameras import PosedCamera, PosedPair, nearest_rotation
from marssim.base.calibration.lenses.fisheye import Fisheye
from marssim.base.calibration.opencv_file import intrinsics, lens_of
from marssim.base.calibration.orientation import RectifiedView
from marssim.base.camera import PinholeCamera

NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
# [1, 2], or one number a line; no part can match the blanks of another, so that long runs of them take no time
_LIST = r"(?:\s*+\[([^\]]*)\]|((?:[ \t\r]*+\n\s*+-[ \t]++\S++)+))"
MODELS = {"plumb_bob": False, "rational_polynomial": False, "equidistant": True, "fisheye": True}  # is it a fisheye?


def _field(long: str, short: str) -> re.Pattern[str]:
    """Return the pattern of a matrix by its name in camera_calibration's files and in the message."""
    block = rf"{long}[ \t]*:(?:\s*+(?:rows|cols)[ \t]*:[ \t]*\d+)*\s*+data"
    return re.compile(rf"^[ \t]*(?:{block}|{short}|{short.lower()})[ \t]*:{_LIST}", re.MULTILINE)


_PROJECTION = _field("projection_matrix", "P")
_CAMERA = _field("camera_matrix", "K")
_ROTATION = _field("rectification_matrix", "R")
_DISTORTION = _field("distortion_coefficients", "D")


@dataclass(frozen=True)
class CameraInfo:
    """A CameraInfo of ROS.

    Attributes:
        projection: (3, 4) matrix P of the rectified camera; [0, 3] of a right camera is -f B [px m].
        size: Width and height [px]; None if the text lacks them.
    """

    projection: np.ndarray
    size: tuple[int, int] | None


@dataclass(frozen=True)
class ImagePart:
    """What the images of a CameraInfo are of the full resolution: its roi and its binning; 0 is all, and none.

    Attributes:
        x_offset, y_offset: First column and row of the region [px].
        width, height: Of the region [px].
        binning_x, binning_y: Pixels of the full resolution for each of the image.
    """

    x_offset: int = 0
    y_offset: int = 0
    width: int = 0
    height: int = 0
    binning_x: int = 0
    binning_y: int = 0

    def cropped(self, matrix: np.ndarray, size: tuple[int, int] | None) -> tuple[np.ndarray, tuple[int, int] | None]:
        """Return K (3, 3) or P (3, 4) of the images, and their width and height [px].

        Args:
            matrix: K or P of the full resolution, which a CameraInfo has (REP 104).
            size: The width and the height of it [px]; None if unknown.
        """
        matrix = matrix.copy()
        if self.width and self.height:
            matrix[0, 2] -= self.x_offset
            matrix[1, 2] -= self.y_offset
            size = self.width, self.height
        binning = max(self.binning_x, 1), max(self.binning_y, 1)
        for row, by in enumerate(binning):  # the outer edge of a binned pixel is that of its parts
            matrix[row, 2] += 0.5
            matrix[row] /= by
            matrix[row, 2] -= 0.5
        return matrix, None if size is None else (size[0] // binning[0], size[1] // binning[1])


def is_camera_info(text: str) -> bool:
    """Tell whether a text looks like a CameraInfo."""
    return (
        _PROJECTION.search(text) is not None
        and re.search(r"^[ \t]*(image_)?width[ \t]*:", text, re.MULTILINE) is not None
    )


def parse_camera_info(text: str) -> CameraInfo:
    """Read what a CameraInfo says about the rectified images, of the region and the binning that they have.

    Raises:
        ValueError: Something is missing or malformed; the message says what.
    """
    if _PROJECTION.search(text) is None:
        raise ValueError("lacks the projection_matrix of a CameraInfo of ROS")
    projection = _matrix(text, _PROJECTION, "projection_matrix", (3, 4))
    if not projection[0, 0] > 0:
        raise ValueError("projection_matrix has no positive focal length: the camera is not calibrated")
    return CameraInfo(*_image_part(text).cropped(projection, _size(text)))


def parse_raw_camera(text: str) -> PosedCamera:
    """Read the camera of a CameraInfo as it was built, in the frame of the rectified left camera.

    Raises:
        ValueError: Something is missing or malformed; the message says what.
    """
    info = parse_camera_info(text)
    k = _image_part(text).cropped(_matrix(text, _CAMERA, "camera_matrix", (3, 3)), None)[0]
    name = re.search(r"^[ \t]*distortion_model[ \t]*:[ \t]*[\"']?(\w*)", text, re.MULTILINE)
    model = name[1] if name else ""
    if model and model not in MODELS:
        raise ValueError(f"distortion_model {model} is not supported; {', '.join(MODELS)} are")
    match = _DISTORTION.search(text)
    terms = np.zeros(0)
    if match is not None:
        terms = fields.numbers(_items(match), "distortion_coefficients")
    turn = nearest_rotation(_matrix(text, _ROTATION, "rectification_matrix", (3, 3))).T
    centre = np.array([-info.projection[0, 3] / info.projection[0, 0], 0, 0])
    return PosedCamera(lens_of(k, terms, MODELS.get(model, False)), turn, centre, info.size)


def camera_info_texts(pair: PosedPair, view: RectifiedView) -> tuple[str, str]:
    """Return the CameraInfos of both cameras, as camera_calibration saves them.

    Args:
        pair: The cameras, with lenses that have coefficients of OpenCV.
        view: The rectified cameras that their R and P describe.

    Raises:
        ValueError: A lens has no such coefficients.
    """
    left = _text(pair.left, view.left, view.rotation, 0.0, "left")
    return left, _text(pair.right, view.right, view.rotation, -view.left.fx * view.baseline, "right")


def _text(camera: PosedCamera, ideal: PinholeCamera, rotation: np.ndarray, tx: float, name: str) -> str:
    k, terms = intrinsics(camera.lens)
    model = "equidistant" if isinstance(camera.lens, Fisheye) else "plumb_bob"
    if model == "plumb_bob":
        terms = (*terms, *(0.0,) * (5 - len(terms)))  # it has five by ROS's definition
        model = "rational_polynomial" if len(terms) > 5 else model
    p = np.column_stack([ideal.K, [tx, 0, 0]])
    width, height = camera.size or (ideal.width, ideal.height)
    lines = [f"image_width: {width}", f"image_height: {height}", f"camera_name: {name}"]
    blocks = {
        "camera_matrix": k, "distortion_coefficients": np.array(terms)[None],
        "rectification_matrix": rotation @ camera.rotation.T, "projection_matrix": p,
    }  # fmt: skip
    for block, matrix in blocks.items():
        if block == "distortion_coefficients":
            lines.append(f"distortion_model: {model}")
        data = ", ".join(repr(float(value)) for value in matrix.ravel())
        lines += [f"{block}:", f"  rows: {matrix.shape[0]}", f"  cols: {matrix.shape[1]}", f"  data: [{data}]"]
    return "\n".join(lines) + "\n"


def _matrix(text: str, pattern: re.Pattern[str], name: str, shape: tuple[int, int]) -> np.ndarray:
    match = pattern.search(text)
    if match is None:
        raise ValueError(f"lacks the {name} of a CameraInfo of ROS")
    values = fields.numbers(_items(match), name)
    if len(values) != shape[0] * shape[1]:
        raise ValueError(f"{name} must have {shape[0] * shape[1]} numbers, has {len(values)}")
    return values.reshape(shape)


def _items(match: re.Match[str]) -> list[str]:
    """Return the items of a matched _LIST, without checking that they are numbers."""
    if match[1] is not None:
        return match[1].replace(",", " ").split()
    return re.findall(r"-[ \t]+(\S+)", match[2])


def _image_part(text: str) -> ImagePart:
    matches = {
        name: re.search(rf"^[ \t]*{name}[ \t]*:[ \t]*(\d+)", text, re.MULTILINE)
        for name in ("x_offset", "y_offset", "binning_x", "binning_y")
    }
    values = {name: int(match[1]) for name, match in matches.items() if match}
    if (region := re.search(r"^[ \t]*roi[ \t]*:", text, re.MULTILINE)) is not None:
        sides = _size(text[region.end() :])
        values |= {} if sides is None else {"width": sides[0], "height": sides[1]}
    return ImagePart(**values)


def _size(text: str) -> tuple[int, int] | None:
    matches = [
        re.search(rf"^[ \t]*(?:image_)?{name}[ \t]*:[ \t]*(\d+)", text, re.MULTILINE) for name in ("width", "height")
    ]
    return (int(matches[0][1]), int(matches[1][1])) if matches[0] and matches[1] else None
