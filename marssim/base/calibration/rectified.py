"""Calibration files of rectified stereo pairs, as KITTI, Middlebury, ETH3D, OpenCV and ROS write them.

KITTI        `P2: ...` and `P3: ...` (or `P_rect_02: ...`), 3 x 4 projection matrices [px, m]
Middlebury   `cam0=[f 0 cx; 0 f cy; 0 0 1]`, `doffs=` [px], `baseline=` [mm]; ETH3D too
OpenCV       YAML, XML or JSON with stereoRectify's P1 and P2, or its Q; baseline in the unit of the calibration target
ROS          CameraInfo of the left and the right camera, as camera_calibration and `topic echo` write it
marssim      a rig file, {"width", "height", "fx", "fy", "cx", "cy", "baseline"} [px, m], with "shift" [px] where the
             right camera has another cx, or a dataset's sample.json
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from marssim.base.calibration import fields
from marssim.base.calibration.bounded_text import parse_json_text, parse_yaml, read_text
from marssim.base.calibration.camera_info import NUMBER, CameraInfo, is_camera_info, parse_camera_info
from marssim.base.calibration.opencv_file import SIDES, SIZES, is_opencv, parse_opencv
from marssim.base.camera import PinholeCamera, StereoRig

ADVICE = "rectify the images first (m3depth.predict --rectify always, or m3depth.rectify)"
ROUNDING = 0.05  # [px] by which the cameras of one rectified pair may differ in a file
SHIFT_KEY = "shift_px"  # of a Calibration's shift in prediction.json
OPENCV = ("%YAML", "<?xml", "{")  # how its files begin
LENS_FIELDS = ("distortion_coefficients", "right", "vergence_deg", "rotation_deg")  # of rig_file
KITTI_GREY = frozenset({"image_0", "image_00"})  # folders of the left grey camera; the left colour camera has number 2


@dataclass(frozen=True)
class Calibration:
    """A rectified pair of cameras.

    Attributes:
        fx, fy: Focal lengths [px].
        cx, cy: Principal point of the left camera [px].
        baseline: Distance of the cameras [m].
        shift: The right camera's cx minus the left one's [px] (Middlebury's doffs): Z = f B / (x_left - x_right +
            shift).
        size: Width and height [px]; None if unknown.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    baseline: float
    shift: float = 0.0
    size: tuple[int, int] | None = None

    def checked(self) -> Calibration:
        """Return this calibration. Raises ValueError if a number is not finite or out of the range of PinholeCamera."""
        PinholeCamera(*(self.size or (1, 1)), self.fx, self.fy, self.cx, self.cy)
        for name, unit in (("baseline", "m"), ("shift", "px")):
            if not np.isfinite(getattr(self, name)):
                raise ValueError(f"{name} must be finite [{unit}], got {getattr(self, name)}")
        return self

    def rig(self, width: int, height: int) -> StereoRig:
        """Return the rig for images of this size, once the right one is moved by `shift` (see align_right).

        Args:
            width: Width of the images [px].
            height: Height of the images [px].
        """
        return StereoRig(PinholeCamera(width, height, self.fx, self.fy, self.cx, self.cy), self.baseline)


def read_calibration(
    path: Path, right: Path | None = None, *, image: Path | None = None, baseline: float | None = None
) -> Calibration:
    """Read a calibration file of any of the kinds above; its contents tell which.

    Args:
        path: The file; the left camera's if ROS has two.
        right: The right camera's CameraInfo of ROS, or the second of two files of OpenCV, such as extrinsics.yml.
        image: Path of the left image; in KITTI's folders it distinguishes the grey cameras from the colour ones.
        baseline: Distance of the cameras [m], for a left CameraInfo alone.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The file is not a calibration, lacks something, or holds numbers that no camera has; the message
            names both.
    """
    text = read_text(path)
    right_text = None if right is None else read_text(right)
    try:
        if is_camera_info(text):
            return _from_ros(text, right_text, baseline).checked()
        if right_text is not None:
            text = _of_opencv_rectification(text, right_text)
        if text.lstrip().startswith(OPENCV):
            return (_from_json(text) or _from_opencv(text)).checked()
        if re.search(r"^[ \t]*cam0[ \t]*=", text, re.MULTILINE):
            return _from_middlebury(text).checked()
        if re.search(r"^[ \t]*P(_rect_0)?\d[ \t]*:", text, re.MULTILINE):
            grey = image is not None and not KITTI_GREY.isdisjoint(image.parts)
            return _from_kitti(text, ("0", "1") if grey else ("2", "3")).checked()
        if re.search(r"^cam0[ \t]*:", text, re.MULTILINE):
            parse_yaml(text)  # Kalibr's, which describes raw cameras; a fault in it is named
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    raise ValueError(
        f"{path}: is not a calibration of KITTI (P2:), Middlebury or ETH3D (cam0=), OpenCV (%YAML), ROS "
        "(projection_matrix:) or marssim (JSON with width, height, fx, fy, cx, cy and baseline)"
    )


def _of_opencv_rectification(first: str, second: str) -> str:
    """Return that of two files of OpenCV which describes rectified images, with P1 and P2 or Q."""
    for text in (second, first):
        if text.lstrip().startswith(OPENCV):
            content = parse_opencv(text)
            if {"P1", "P2"} <= content.keys() or "Q" in content:
                return text
    raise ValueError(
        "is not a CameraInfo of ROS, and neither file holds P1 and P2 or Q of OpenCV's stereoRectify, the only kinds "
        f"that come in two files; {ADVICE}"
    )


def align_right(right: np.ndarray, shift: float) -> np.ndarray:
    """Shift the right image to the left by `shift` px, as if both cameras had the same principal point.

    Args:
        right: (H, W) or (H, W, 3) uint8.
        shift: See Calibration [px].

    Returns:
        The same shape; the border is repeated where the image ends. Between the pixels, it is the polynomial of
        degree 7 through eight of them (Lagrange), which moves smooth images by `shift` exactly. OpenCV's warps round
        it to 1/32 px.
    """
    if shift == 0:
        return right
    whole = math.floor(shift)
    taps = np.arange(-3, 5)
    weights = [np.prod([(shift - whole - j) / (k - j) for j in taps if j != k]) for k in taps]
    between = cv2.filter2D(right, -1, np.array([weights]), anchor=(3, 0), borderType=cv2.BORDER_REPLICATE)
    columns = np.clip(np.arange(right.shape[1]) + whole, 0, right.shape[1] - 1)
    return np.ascontiguousarray(between[:, columns])


def _from_json(text: str) -> Calibration | None:
    """Read marssim's rig file or sample.json; None for another file."""
    if not text.lstrip().startswith("{"):
        return None
    data = parse_json_text(text)
    of_opencv = is_opencv(data) or {"P1", "P2"} <= data.keys() or "Q" in data
    if of_opencv or not ("rig" in data or "baseline" in data):
        return None
    content = data.get("rig", data)
    if isinstance(content, dict) and (lenses := [name for name in LENS_FIELDS if _is_set(content.get(name))]):
        raise ValueError(
            f"describes raw cameras ({', '.join(lenses)}), as for marssim.generate; for its rectified images give the "
            "sample.json beside them, and for those of --raw its calibration/opencv.yml"
        )
    rig = StereoRig.from_dict(content)
    c = rig.camera
    nested = "shift" not in data and "shift" in content
    shift = float(fields.matrix(content if nested else data, "shift", (1,))[0]) if nested or "shift" in data else 0.0
    return Calibration(c.fx, c.fy, c.cx, c.cy, rig.baseline, shift, (c.width, c.height))


def _is_set(value: object) -> bool:
    """Return whether the field of a lens says anything: not if all of its numbers are 0."""
    if isinstance(value, list):
        return any(map(_is_set, value))
    return bool(value)


def _from_projections(left: np.ndarray, right: np.ndarray) -> Calibration:
    """Return the calibration of two (3, 4) projection matrices K [I | t] of one rectified frame; t along x only."""
    if not (left[0, 0] > 0 and right[0, 0] > 0):
        raise ValueError("the projection matrices have no positive focal length")
    for name, at in (("focal lengths", (0, 0)), ("vertical focal lengths", (1, 1)), ("principal points' rows", (1, 2))):
        if abs(left[at] - right[at]) > ROUNDING:
            raise ValueError(
                f"the {name} of the two cameras are {left[at]:g} and {right[at]:g} px: the cameras of a rectified pair "
                "have the same"
            )
    if abs(right[1, 3] - left[1, 3]) > abs(right[0, 3] - left[0, 3]):
        raise ValueError("one camera stands above the other; only pairs side by side can be used")
    baseline = left[0, 3] / left[0, 0] - right[0, 3] / right[0, 0]
    fx, fy, cx, cy = (float(left[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2)))
    return Calibration(fx, fy, cx, cy, float(baseline), float(right[0, 2] - left[0, 2]))


def calibration_of_infos(left: CameraInfo, right: CameraInfo) -> Calibration:
    """Return the calibration of the CameraInfos of both cameras.

    Raises:
        ValueError: They are exchanged, hold no baseline, or are not those of one pair.
    """
    if left.projection[0, 3] != 0 or right.projection[0, 3] == 0:
        raise ValueError("the left camera's CameraInfo (Tx = 0) comes first, then the right one's (Tx = -f B)")
    if left.size is not None and right.size is not None and left.size != right.size:
        sizes = (f"{size[0]} x {size[1]}" for size in (left.size, right.size))
        raise ValueError(f"the CameraInfos are for images of {' and '.join(sizes)} px: both must have one size")
    return replace(_from_projections(left.projection, right.projection), size=left.size)


def _from_ros(left_text: str, right_text: str | None, baseline: float | None) -> Calibration:
    """Read the CameraInfo of both cameras, of the right one alone, or of the left one with a baseline."""
    first: CameraInfo = parse_camera_info(left_text)
    if right_text is not None:
        return calibration_of_infos(first, parse_camera_info(right_text))
    if first.projection[0, 3] == 0:
        if baseline is None:
            raise ValueError(
                "is the left camera's CameraInfo (Tx = 0); give the right camera's, which holds the baseline"
            )
        p = first.projection
        calibration = Calibration(p[0, 0], p[1, 1], p[0, 2], p[1, 2], baseline)
    else:
        alone = first.projection.copy()
        alone[0, 3] = 0
        calibration = _from_projections(alone, first.projection)
    return replace(calibration, size=first.size)


def _from_kitti(text: str, eyes: tuple[str, str]) -> Calibration:
    matrices = {
        number: np.array([float(value) for value in values.split()])
        for number, values in re.findall(rf"^[ \t]*P(?:_rect_0)?(\d)[ \t]*:((?:\s+{NUMBER})+)", text, re.MULTILINE)
    }
    present = [pair for pair in (eyes, ("2", "3"), ("0", "1")) if all(eye in matrices for eye in pair)]
    if not present:
        raise ValueError("lacks the projection matrices of two cameras, P2 and P3 or P0 and P1")
    for eye in present[0]:
        if matrices[eye].size != 12:
            raise ValueError(f"P{eye} must have 12 numbers, has {matrices[eye].size}")
    return _from_projections(*(matrices[eye].reshape(3, 4) for eye in present[0]))


def _from_middlebury(text: str) -> Calibration:
    """Read a calibration of Middlebury or ETH3D. Without doffs, cam1 gives the shift, and without both it is 0."""
    lines = re.findall(r"^[ \t]*(\w+)[ \t]*=(.*)$", text, re.MULTILINE)
    content = {name: value.strip(" \t\r") for name, value in lines}
    size = None
    if {"width", "height"} <= content.keys():
        sides = [_middlebury_number(content, name) for name in ("width", "height")]
        if not all(side.is_integer() for side in sides):
            raise ValueError(f"width and height must be whole numbers, got {sides[0]:g} and {sides[1]:g}")
        size = int(sides[0]), int(sides[1])
    baseline = _middlebury_number(content, "baseline") / 1000
    left = _middlebury_camera(content, "cam0")
    calibration = Calibration(*left, baseline, 0.0, size).checked()
    if "cam1" not in content:
        return replace(calibration, shift=_middlebury_number(content, "doffs") if "doffs" in content else 0.0)
    right = _middlebury_camera(content, "cam1")
    if max(abs(left[i] - right[i]) for i in (0, 1, 3)) > ROUNDING:
        raise ValueError("cam0 and cam1 differ in more than cx, so the images are not rectified")
    shift = right[2] - left[2]
    if "doffs" not in content:
        return replace(calibration, shift=shift)
    if abs((doffs := _middlebury_number(content, "doffs")) - shift) > ROUNDING:
        raise ValueError(f"doffs is {doffs:g} px, and the cx of cam0 and cam1 are {shift:g} px apart")
    return replace(calibration, shift=doffs)


def _middlebury_camera(content: Mapping[str, str], name: str) -> tuple[float, float, float, float]:
    """Return fx, fy, cx, cy [px] of the matrix of a camera, [fx 0 cx; 0 fy cy; 0 0 1]."""
    if name not in content:
        raise ValueError(f"field {name} is missing")
    values = [float(value) for value in re.findall(NUMBER, content[name])]
    if len(values) != 9:
        raise ValueError(f"{name} must have 9 numbers, has {len(values)}")
    return values[0], values[4], values[2], values[5]


def _middlebury_number(content: Mapping[str, str], name: str) -> float:
    if name not in content:
        raise ValueError(f"field {name} is missing")
    try:
        return float(content[name])
    except ValueError:
        raise ValueError(f"field {name} must be a number, got {content[name]!r:.40}") from None


def _from_opencv(text: str) -> Calibration:
    content = parse_opencv(text)
    size = fields.size(content, SIZES, SIDES)
    if {"P1", "P2"} <= content.keys():
        matrices = (fields.matrix(content, name, (3, 4)) for name in ("P1", "P2"))
        return replace(_from_projections(*matrices), size=size)
    if "Q" in content and (q := fields.matrix(content, "Q", (4, 4)))[3, 2] != 0:
        # Q holds -cx, -cy, f, -1 / Tx and (cx - cx') / Tx (OpenCV, stereoRectify).
        inverse, f = float(q[3, 2]), float(q[2, 3])
        return Calibration(f, f, -float(q[0, 3]), -float(q[1, 3]), 1 / inverse, float(q[3, 3]) / inverse, size)
    if is_opencv(content):
        raise ValueError(f"is a calibration of images that are not rectified; {ADVICE}")
    raise ValueError(f"holds neither P1 and P2 nor Q of stereoRectify; {ADVICE}")
