"""sensor_msgs/CameraInfo in a bag: the rectified camera and the raw one, at the size of their images."""

from __future__ import annotations

from typing import Any

import numpy as np

from marssim.base.calibration.camera_info import MODELS, CameraInfo, ImagePart
from marssim.base.calibration.cameras import PosedCamera, nearest_rotation
from marssim.base.calibration.opencv_file import lens_of

SAME_CAMERA = 0.05  # [px] by which focal lengths and middles of one camera may differ


def rectified_camera(message: Any) -> CameraInfo:
    """Return what a CameraInfo says about its rectified images: P of the region and the binning that they have.

    Raises:
        ValueError: The camera is not calibrated; the message says so.
    """
    return CameraInfo(*_of_image(message.p, "P", message))


def raw_camera(message: Any) -> PosedCamera:
    """Return the camera of a CameraInfo as it was built, in the frame of the rectified camera.

    Raises:
        ValueError: The camera is not calibrated, or its distortion is not supported; the message says so.
    """
    _check_finite(D=message.d, R=message.r)
    k, size = _of_image(message.k, "K", message)
    model = message.distortion_model
    if model and model not in MODELS:
        raise ValueError(f"distortion_model {model} is not supported; {', '.join(MODELS)} are")
    rotation = np.array(message.r, float).reshape(3, 3)
    turn = nearest_rotation(rotation).T if rotation.any() else np.eye(3)
    return PosedCamera(lens_of(k, np.array(message.d, float), MODELS.get(model, False)), turn, np.zeros(3), size)


def _check_finite(**values: Any) -> None:
    for name, numbers in values.items():
        if not np.isfinite(np.array(numbers, float)).all():
            raise ValueError(f"{name} holds numbers that are not finite: the camera is not calibrated")


def _of_image(values: Any, name: str, message: Any) -> tuple[np.ndarray, tuple[int, int] | None]:
    """Return K (3, 3) or P (3, 4) of the region and the binning of the images, and their width and height [px]."""
    matrix = np.array(values, float).reshape(3, -1)
    _check_finite(**{name: matrix})
    if not (matrix[0, 0] > 0 and matrix[1, 1] > 0):
        raise ValueError(f"{name} has no positive focal length: the camera is not calibrated")
    roi = message.roi
    part = ImagePart(
        int(roi.x_offset), int(roi.y_offset), int(roi.width), int(roi.height), int(message.binning_x),
        int(message.binning_y),
    )  # fmt: skip
    return part.cropped(matrix, (int(message.width), int(message.height)))


def rectifies_to_another_camera(message: Any) -> bool:
    """Return whether the rectified camera, P, has another focal length or middle than the raw one, K.

    Raises:
        ValueError: The camera is not calibrated; the message says so.
    """
    k, p = (_of_image(values, name, message)[0] for values, name in ((message.k, "K"), (message.p, "P")))
    return bool(np.abs(p[:, :3] - k).max() > SAME_CAMERA)


def shows_raw_images(message: Any) -> bool:
    """Return whether the camera has a distortion or a rotation, which rectified images no longer show.

    Raises:
        ValueError: The camera is not calibrated; the message says so.
    """
    _check_finite(D=message.d, R=message.r)
    turned = np.abs(np.array(message.r, float).reshape(3, 3) - np.eye(3)).max() > 1e-9
    return bool(turned and np.any(message.r)) or bool(np.any(np.abs(message.d) > 1e-12))
