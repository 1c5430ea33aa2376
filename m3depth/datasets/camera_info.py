"""ROS's CameraInfo as text: the YAML that camera_calibration saves, and what `rostopic echo`, `ros2 topic echo` print.

Only plain keys with numbers are read, by pattern; no YAML is loaded.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_LIST = rf"(?:\[([^\]]*)\]|((?:\s*\n\s*-\s*{NUMBER})+))"  # [1, 2] or a line each
_PROJECTION = re.compile(
    rf"^\s*(?:projection_matrix\s*:(?:\s*(?:rows|cols)\s*:\s*\d+)*\s*data|P|p)\s*:\s*{_LIST}", re.MULTILINE
)


@dataclass(frozen=True)
class CameraInfo:
    """projection: (3, 4) P of the rectified camera, [0, 3] is -f B of a right eye [px m]; size: width, height [px], or
    None if they are not told."""

    projection: np.ndarray
    size: tuple[int, int] | None


def is_camera_info(text: str) -> bool:
    """Whether a text looks like one."""
    return _PROJECTION.search(text) is not None and re.search(r"^\s*(image_)?width\s*:", text, re.MULTILINE) is not None


def parse_camera_info(text: str) -> CameraInfo:
    """Raises ValueError that says what is missing."""
    match = _PROJECTION.search(text)
    if match is None:
        raise ValueError("holds no projection_matrix, which ROS's CameraInfo does")
    numbers = [float(number) for number in re.findall(NUMBER, match[1] or match[2] or "")]
    if len(numbers) != 12:
        raise ValueError(f"projection_matrix must have 12 numbers, has {len(numbers)}")
    projection = np.array(numbers).reshape(3, 4)
    if not projection[0, 0] > 0:
        raise ValueError("projection_matrix has no positive focal length: the camera is not calibrated")
    return CameraInfo(projection, _size(text))


def _size(text: str) -> tuple[int, int] | None:
    found = [re.search(rf"^\s*(?:image_)?{name}\s*:\s*(\d+)", text, re.MULTILINE) for name in ("width", "height")]
    return (int(found[0][1]), int(found[1][1])) if found[0] and found[1] else None
