"""Where the rectified left camera is: in the frame of the raw one, and on the rover.

The rover's frame is that of the project, x ahead, y left, z up. That of labels has y right and z down, with the origin
on the ground (rover navigation frame of Mars 2020 and MSL).
"""

from __future__ import annotations

import numpy as np

from marssim.base.calibration.cameras import PosedPair

ROVER_FRAME = "ROVER_NAV_FRAME"  # of labels
Z_UP = np.diag([1.0, -1.0, -1.0])  # y right, z down to y left, z up


def rectified_to_raw(cameras: PosedPair, rotation: np.ndarray) -> np.ndarray:
    """Return the pose of the rectified left camera in the frame of the raw one, (4, 4): a rotation.

    Args:
        cameras: The calibration.
        rotation: (3, 3) frame of the calibration to that of the rectified cameras.
    """
    pose = np.eye(4)
    pose[:3, :3] = cameras.left.rotation @ rotation.T
    return pose


def rectified_to_rover(cameras: PosedPair, rotation: np.ndarray) -> np.ndarray | None:
    """Return the pose of the rectified left camera on the rover, (4, 4) camera to rover; None without labels of it.

    Args:
        cameras: The calibration.
        rotation: (3, 3) frame of the calibration to that of the rectified cameras.
    """
    if not cameras.left.frame.startswith(ROVER_FRAME):
        return None
    pose = np.eye(4)
    pose[:3, :3] = Z_UP @ rotation.T
    pose[:3, 3] = Z_UP @ cameras.left.centre
    return pose
