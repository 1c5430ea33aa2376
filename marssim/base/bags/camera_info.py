"""sensor_msgs/CameraInfo in a bag: the rectified camera, at the size of its images."""

from __future__ import annotations

from typing import Any

import numpy as np

from marssim.base.calibration.camera_info import CameraInfo


def rectified_camera(message: Any) -> CameraInfo:
    """Return what a CameraInfo says about its rectified images: P of the region and the binning that they have.

    K and P are those of the full resolution (REP 104). The outer edge of a binned pixel is that of its parts.

    Raises:
        ValueError: The camera is not calibrated; the message says so.
    """
    projection = np.array(message.p, float).reshape(3, 4)
    if not np.isfinite(projection).all() or not (projection[0, 0] > 0 and projection[1, 1] > 0):
        raise ValueError("P has no positive focal length: the camera is not calibrated")
    roi, size = message.roi, (int(message.width), int(message.height))
    if roi.width and roi.height:
        projection[0, 2] -= roi.x_offset
        projection[1, 2] -= roi.y_offset
        size = int(roi.width), int(roi.height)
    binning = max(int(message.binning_x), 1), max(int(message.binning_y), 1)
    for row, by in enumerate(binning):
        projection[row, 2] += 0.5
        projection[row] /= by
        projection[row, 2] -= 0.5
    return CameraInfo(projection, (size[0] // binning[0], size[1] // binning[1]))


def shows_raw_images(message: Any) -> bool:
    """Return whether the camera has a distortion or a rotation, which rectified images no longer show."""
    turned = np.abs(np.array(message.r, float).reshape(3, 3) - np.eye(3)).max() > 1e-9
    return bool(turned and np.any(message.r)) or bool(np.any(np.abs(message.d) > 1e-12))
