"""A small calibration of raw pairs in each format that is read, and the function that reads it."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from marssim.base.calibration.camera_info import camera_info_texts
from marssim.base.calibration.cameras import PosedPair, first_camera, from_vectors, second_camera
from marssim.base.calibration.kalibr import kalibr_text
from marssim.base.calibration.lenses.radial_tangential import RadialTangential
from marssim.base.calibration.opencv_file import opencv_text
from marssim.base.calibration.orientation import rectified_view
from marssim.base.calibration.pds3_label import camera_group
from marssim.base.calibration.read_pair import read_raw_calibration

SIZE = (8, 6)
SECOND = "second_"  # begins the name of the right eye's file
RADTAN = (-0.2, 0.05, 1e-3, -7e-4)
ZHURONG = """<?xml version="1.0"?><Product><Array_2D_Image>
<Axis_Array><axis_name>Line</axis_name><elements>2048</elements></Axis_Array>
<Axis_Array><axis_name>Sample</axis_name><elements>2048</elements></Axis_Array></Array_2D_Image>
<focal_length>13.17</focal_length><pixel_size>5.5</pixel_size><x0>0.01</x0><y0>0.02</y0>
<Exterior_Orientation_Elements><camera_center_position_x>1.0</camera_center_position_x>
<camera_center_position_y>{y}</camera_center_position_y><camera_center_position_z>1.8</camera_center_position_z>
<camera_rotation_angle_x>70</camera_rotation_angle_x><camera_rotation_angle_y>0</camera_rotation_angle_y>
<camera_rotation_angle_z>-90</camera_rotation_angle_z></Exterior_Orientation_Elements></Product>"""


def _pair() -> PosedPair:
    lens = RadialTangential(10.0, 10.0, 3.5, 2.5, RADTAN)
    return PosedPair(first_camera(lens, SIZE), second_camera(lens, np.eye(3), np.array([-0.2, 0.0, 0.0]), SIZE))


def _pds3(y: float) -> str:
    """Return the label of an image of a camera at y that looks along x, in a frame with z down."""
    axis, zero = np.array([1.0, 0.0, 0.0]), (0.0, 0.0, 0.0)
    h, v = np.array([3.5, 10.0, 0.0]), np.array([2.5, 0.0, 10.0])
    camera = from_vectors(np.array([0.9, y, -1.9]), axis, h, v, axis, zero, zero, 1.0, SIZE, "ROVER")
    image = f"OBJECT = IMAGE\r\n LINES = {SIZE[1]}\r\n LINE_SAMPLES = {SIZE[0]}\r\nEND_OBJECT = IMAGE"
    return f"PDS_VERSION_ID = PDS3\r\nFRAME_ID = LEFT\r\n{camera_group(camera)}\r\n{image}\r\nEND\r\n"


def _opencv(folder: Path, suffix: str) -> Path:
    """Write OpenCV's file by OpenCV itself."""
    path, camera = folder / f"stereo.{suffix}", np.array([[10.0, 0, 3.5], [0, 10.0, 2.5], [0, 0, 1]])
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", SIZE[0])
    storage.write("image_height", SIZE[1])
    for name, value in (("K1", camera), ("K2", camera), ("D1", np.array([RADTAN])), ("D2", np.array([RADTAN]))):
        storage.write(name, value)
    storage.write("R", np.eye(3))
    storage.write("T", np.array([[-0.2], [0.0], [0.0]]))
    storage.release()
    return path


def _texts(folder: Path, name: str, texts: tuple[str, ...]) -> Path:
    """Write the texts of one file, or of one for each eye, and return the first."""
    for file, text in zip((name, SECOND + name), texts):
        (folder / file).write_text(text, encoding="utf-8")
    return folder / name


def read_calibration_pair(path: Path) -> PosedPair:
    """Read the attacked file, with that of the right eye where there is one."""
    second = path.with_name(SECOND + path.name)
    return read_raw_calibration([path, *([second] if second.exists() else [])])


CALIBRATIONS = {
    "OpenCV calibration": lambda folder: _texts(folder, "stereo.yaml", (opencv_text(_pair()),)),
    "OpenCV calibration .xml": lambda folder: _opencv(folder, "xml"),
    "OpenCV calibration .json": lambda folder: _opencv(folder, "json"),
    "Kalibr calibration": lambda folder: _texts(folder, "chain.yaml", (kalibr_text(_pair()),)),
    "ROS calibration": lambda folder: _texts(
        folder, "left.yaml", tuple(camera_info_texts(_pair(), rectified_view(_pair())))
    ),
    "PDS3 label": lambda folder: _texts(folder, "left.LBL", (_pds3(-0.2), _pds3(0.2))),
    "PDS4 label": lambda folder: _texts(folder, "left.2CL", (ZHURONG.format(y=0.1), ZHURONG.format(y=-0.1))),
}
