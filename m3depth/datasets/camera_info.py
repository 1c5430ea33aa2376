"""ROS's CameraInfo as text: the YAML of camera_calibration, and the output of `rostopic echo` and `ros2 topic echo`.

It reads only plain keys with numbers, by regular expressions; it loads no YAML.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_LIST = rf"(?:\[([^\]]*)\]|((?:\s*\n\s*-\s*{NUMBER})+))"  # [1, 2], or one number a line
_PROJECTION = re.compile(
    rf"^\s*(?:projection_matrix\s*:(?:\s*(?:rows|cols)\s*:\s*\d+)*\s*data|P|p)\s*:\s*{_LIST}", re.MULTILINE
)


@dataclass(frozen=True)
class CameraInfo:
    """A CameraInfo of ROS.

    Attributes:
        projection: (3, 4) matrix P of the rectified camera; [0, 3] of a right camera is -f B [px m].
        size: Width and height [px]; None if the text lacks them.
    """

    projection: np.ndarray
    size: tuple[int, int] | None


def is_camera_info(text: str) -> bool:
    """Tell whether a text looks like a CameraInfo."""
    return _PROJECTION.search(text) is not None and re.search(r"^\s*(image_)?width\s*:", text, re.MULTILINE) is not None


def parse_camera_info(text: str) -> CameraInfo:
    """Read a CameraInfo.

    Raises:
        ValueError: Something is missing or malformed; the message says what.
    """
    match = _PROJECTION.search(text)
    if match is None:
        raise ValueError("lacks the projection_matrix of a CameraInfo of ROS")
    numbers = [float(number) for number in re.findall(NUMBER, match[1] or match[2] or "")]
    if len(numbers) != 12:
        raise ValueError(f"projection_matrix must have 12 numbers, has {len(numbers)}")
    projection = np.array(numbers).reshape(3, 4)
    if not projection[0, 0] > 0:
        raise ValueError("projection_matrix has no positive focal length: the camera is not calibrated")
    return CameraInfo(projection, _size(text))


def _size(text: str) -> tuple[int, int] | None:
    matches = [re.search(rf"^\s*(?:image_)?{name}\s*:\s*(\d+)", text, re.MULTILINE) for name in ("width", "height")]
    return (int(matches[0][1]), int(matches[1][1])) if matches[0] and matches[1] else None
