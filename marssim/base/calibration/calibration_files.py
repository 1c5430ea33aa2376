"""Writes the calibration of a raw rig in every form that holds its lenses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from marssim.base.calibration.camera_info import camera_info_texts
from marssim.base.calibration.kalibr import kalibr_text
from marssim.base.calibration.lenses.conversion import cahvore_of
from marssim.base.calibration.opencv_file import opencv_text
from marssim.base.calibration.pds3_label import label_text
from marssim.base.calibration.rig_file import RawRig

FORMS = {
    "opencv": ("opencv.yml",),
    "ros": ("ros_left.yaml", "ros_right.yaml"),
    "kalibr": ("kalibr.yaml",),
    "cahvore": ("cahvore_left.lbl", "cahvore_right.lbl"),
}
"""Names of the files of each form."""


def calibration_texts(raw: RawRig) -> dict[str, str]:
    """Return the calibration files of a rig, by name.

    Args:
        raw: The rig.

    Returns:
        The text of the files of each form of FORMS. A form that cannot hold the lenses is left out: OpenCV, ROS and
        Kalibr have no CAHVORE models, Kalibr no more than four terms, and CAHVORE no tangential distortion.
    """
    texts: dict[str, str] = {}
    for form, names in FORMS.items():
        try:
            texts |= dict(zip(names, _WRITERS[form](raw), strict=True))
        except ValueError:
            continue
    return texts


def _labels(raw: RawRig) -> tuple[str, ...]:
    cameras = (raw.cameras.left, raw.cameras.right)
    return tuple(label_text(replace(camera, lens=cahvore_of(camera.lens))) for camera in cameras)


_WRITERS: dict[str, Callable[[RawRig], tuple[str, ...]]] = {
    "opencv": lambda raw: (opencv_text(raw.cameras),),
    "ros": lambda raw: camera_info_texts(raw.cameras, raw.view),
    "kalibr": lambda raw: (kalibr_text(raw.cameras),),
    "cahvore": _labels,
}
