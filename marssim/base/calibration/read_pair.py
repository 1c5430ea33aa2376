"""Read the calibration of a raw pair, of any kind: the contents of the files tell which.

OpenCV     one file with K1 D1 K2 D2 R T, or two that complete each other (intrinsics and extrinsics)
ROS        CameraInfo of the left and of the right camera
Kalibr     camchain.yaml
PDS, VICAR labels of the left and of the right image (product_label.py), attached or detached
others     a calibration of a rectified pair (rectified.py), as two pinhole cameras
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from marssim.base.calibration.bounded_text import parse_yaml, read_text
from marssim.base.calibration.camera_info import is_camera_info, parse_raw_camera
from marssim.base.calibration.cameras import PosedCamera, PosedPair, first_camera
from marssim.base.calibration.fields import read_in
from marssim.base.calibration.kalibr import is_kalibr, pair_of_kalibr
from marssim.base.calibration.lenses.fisheye import Fisheye
from marssim.base.calibration.lenses.radial_tangential import RadialTangential
from marssim.base.calibration.opencv_file import is_opencv, pair_of_opencv, parse_opencv
from marssim.base.calibration.pds3_label import is_pds3, read_pds3
from marssim.base.calibration.pds4_label import read_pds4
from marssim.base.calibration.product_label import ProductLabel
from marssim.base.calibration.rectified import read_calibration
from marssim.base.calibration.zhurong import FRAME as ZHURONG_FRAME
from marssim.base.calibration.zhurong import check_frames as check_zhurong_frames
from marssim.base.command.input_file import check_file

HEAD = 200_000  # bytes of a file that tell its kind
STRAIGHT = 1e-4  # [rad] largest turn of a camera whose images are rectified


def read_raw_calibration(paths: Sequence[Path], fisheye: bool = False) -> PosedPair:
    """Read the calibration of a pair.

    Args:
        paths: One file of the pair, or those of the left and of the right camera.
        fisheye: See pair_of_opencv.

    Raises:
        FileNotFoundError: A file is missing.
        ValueError: A file is no calibration, lacks something, or says that its lenses are no fisheyes. One line that
            names the file and the field.
    """
    if not 1 <= len(paths) <= 2:
        raise ValueError(f"a pair has one or two calibration files, got {len(paths)}")
    pair, says_lens = _read(paths, fisheye)
    if fisheye and says_lens and not isinstance(pair.left.lens, Fisheye):
        raise ValueError(f"{paths[0]}: says which lens it is of, and that is no fisheye; leave --fisheye out")
    return pair


def _read(paths: Sequence[Path], fisheye: bool) -> tuple[PosedPair, bool]:
    """Return the cameras, and whether the files say by themselves of which kind their lenses are."""
    name = paths[0] if len(paths) == 1 else f"{paths[0]} and {paths[1]}"
    labels = [read_label(path) for path in paths]
    if any(label is not None for label in labels):
        if len(paths) == 1:
            raise ValueError(f"{paths[0]}: is the label of one image; give those of the left and of the right one")
        return labelled_pair(labels, paths), True
    texts = [read_text(path) for path in paths]
    if all(map(_is_camera_info, texts)):
        if len(paths) == 1:
            raise ValueError(f"{paths[0]}: is the CameraInfo of one camera; give those of the left and the right one")
        left, right = (read_in(path, parse_raw_camera, text) for path, text in zip(paths, texts))
        return read_in(name, PosedPair, left, right), True
    content = _content(paths, texts)
    if is_kalibr(content):
        return read_in(name, pair_of_kalibr, content), True
    if is_opencv(content):
        return read_in(name, pair_of_opencv, content, fisheye), False
    return _rectified(paths), True


def is_of_raw_cameras(paths: Sequence[Path]) -> bool:
    """Return whether a calibration describes raw cameras alone: labels, Kalibr, or OpenCV without P1 and Q.

    CameraInfo of ROS, and files of OpenCV with the result of stereoRectify, describe rectified images too: False.

    Raises:
        FileNotFoundError: A file is missing.
        ValueError: A file is malformed. One line that names it.
    """
    for path in paths:
        check_file(path, "calibration file")
    if any(map(has_label, paths)):
        return True
    texts = [read_text(path) for path in paths]
    if any(map(_is_camera_info, texts)):
        return False
    content = _content(paths, texts)
    return is_kalibr(content) or (is_opencv(content) and "P1" not in content and "Q" not in content)


def calibration_of_distorted_images(paths: Sequence[Path]) -> Path | None:
    """Return the first calibration of ROS or OpenCV that describes a distorted or a turned camera, or None.

    Its rectified images have neither, so it also describes other images, which may be those that are given.

    Raises:
        ValueError: A file is malformed. One line that names it.
    """
    texts = [read_text(path) for path in paths]
    for path, text in zip(paths, texts, strict=True):
        if _is_camera_info(text) and not _sees_rectified(read_in(path, parse_raw_camera, text)):
            return path
    content = _content(paths, texts)
    if is_opencv(content):
        with suppress(ValueError):  # it lacks the raw cameras, so it describes rectified images only
            pair = pair_of_opencv(content)
            if not (_sees_rectified(pair.left) and _sees_rectified(pair.right)):
                return paths[0]
    return None


def _sees_rectified(camera: PosedCamera) -> bool:
    """Return whether the images of a camera are rectified as it takes them: no distortion, no turn, no step aside."""
    straight = isinstance(camera.lens, RadialTangential) and not any(camera.lens.coefficients)
    aside = np.abs(camera.centre[1:]).max() > STRAIGHT * np.linalg.norm(camera.centre)
    return straight and not aside and np.allclose(camera.rotation, np.eye(3), atol=STRAIGHT)


def read_label(path: Path) -> ProductLabel | None:
    """Read the label of an image; None if the file is none of PDS or VICAR.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The label is malformed. One line that names the file.
    """
    check_file(path, "calibration file")
    reader = _label_reader(path)
    return None if reader is None else reader(path)


def has_label(path: Path) -> bool:
    """Return whether a file begins as labels of PDS and VICAR do. It may be broken after that."""
    return _label_reader(path) is not None


def _label_reader(path: Path) -> Callable[[Path], ProductLabel] | None:
    """Return what reads the label that a file begins with; None if it begins with none."""
    with path.open("rb") as file:
        head = file.read(HEAD)
    if is_pds3(head):
        return read_pds3
    if head.lstrip().startswith((b"<?xml", b"\xef\xbb\xbf<?xml")) and b"<opencv_storage" not in head:
        return read_pds4
    return None


def labelled_pair(labels: Sequence[ProductLabel | None], paths: Sequence[Path]) -> PosedPair:
    """Return the cameras of the labels of a left and a right image.

    Raises:
        ValueError: A label has no camera model, or the cameras are no pair. One line that names the files.
    """
    left, right = (_labelled_camera(label, path) for label, path in zip(labels, paths, strict=True))
    name = " and ".join(map(str, paths))
    pair = read_in(name, PosedPair, left, right)
    if pair.left.frame == ZHURONG_FRAME:
        read_in(name, check_zhurong_frames, pair)
    return pair


def _labelled_camera(label: ProductLabel | None, path: Path) -> PosedCamera:
    """Return the camera of a label.

    Raises:
        ValueError: There is no label, or it has no camera model.
    """
    if label is None or label.camera is None:
        raise ValueError(
            f"{path}: has no label with a camera model (GEOMETRIC_CAMERA_MODEL or GEOMETRIC_CAMERA_MODEL_PARMS)"
        )
    return label.camera


def _is_camera_info(text: str) -> bool:
    """Return whether a text is a CameraInfo of ROS, and not a camchain of Kalibr."""
    return is_camera_info(text) and "camera_model" not in text


def _content(paths: Sequence[Path], texts: Sequence[str]) -> dict[str, Any]:
    """Return the fields of files of OpenCV or Kalibr that complete each other; none of files of other kinds.

    Raises:
        ValueError: A file of OpenCV is malformed. One line that names it.
    """
    content: dict[str, Any] = {}
    for path, text in zip(paths, texts, strict=True):
        if text.lstrip().startswith(("%YAML", "<", "{")):
            content.update(read_in(path, parse_opencv, text))
        elif re.search(r"^cam0[ \t]*:", text, re.MULTILINE):  # of Kalibr
            content.update(read_in(path, parse_yaml, text))
        elif ":" in text:
            with suppress(ValueError):  # KITTI's files, for one
                content.update(parse_yaml(text))
    return content


def _rectified(paths: Sequence[Path]) -> PosedPair:
    """Return two pinhole cameras for the calibration of a rectified pair."""
    calibration = read_calibration(*paths)
    left = RadialTangential(calibration.fx, calibration.fy, calibration.cx, calibration.cy)
    right = RadialTangential(calibration.fx, calibration.fy, calibration.cx + calibration.shift, calibration.cy)
    second = PosedCamera(right, np.eye(3), np.array([calibration.baseline, 0, 0]), calibration.size)
    return read_in(paths[0], PosedPair, first_camera(left, calibration.size), second)
