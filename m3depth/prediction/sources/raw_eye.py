"""One eye of a bag whose images are as the camera takes them: they are rectified as its CameraInfo says."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from marssim.base.calibration.cameras import PosedCamera
from marssim.base.camera import PinholeCamera
from marssim.base.images.resampling import pixel_grid, rectifying, resample


class RawEye:
    """Rectifies the images of a camera.

    Attributes:
        rectified_to_raw: (4, 4) pose of the rectified camera in the frame of the raw one: a rotation.

    Args:
        camera: The camera as it was built, in the frame of the rectified one.
        ideal: The rectified camera.
        valid: (H, W) bool, where the raw images show the scene; None: everywhere.
    """

    def __init__(self, camera: PosedCamera, ideal: PinholeCamera, valid: np.ndarray | None = None) -> None:
        self._camera, self._ideal = camera, ideal
        self._valid = np.ones((ideal.height, ideal.width), bool) if valid is None else valid
        self.rectified_to_raw = np.eye(4)
        self.rectified_to_raw[:3, :3] = camera.rotation

    @cached_property
    def _places(self) -> np.ndarray:
        """(H, W, 2) where each rectified pixel lies in the raw image [px]."""
        source = rectifying(self._camera, self._ideal, np.eye(3))
        return source(pixel_grid(self._ideal.width, self._ideal.height))

    @cached_property
    def shown(self) -> np.ndarray:
        """(H, W) bool, where a rectified image shows what the raw one shows."""
        return self._resample(np.zeros((self._ideal.height, self._ideal.width), np.uint8))[1]

    def rectified(self, image: np.ndarray) -> np.ndarray:
        """Return a rectified image.

        Args:
            image: (H, W) or (H, W, 3) uint8 or uint16.

        Raises:
            ValueError: The image has another size than the camera.
        """
        height, width = image.shape[:2]
        if (width, height) != (self._ideal.width, self._ideal.height):
            size = f"{self._ideal.width} x {self._ideal.height}"
            raise ValueError(f"the image is {width} x {height}, its CameraInfo says {size}")
        return self._resample(image)[0]

    def _resample(self, image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return resample(image, self._valid, lambda _: self._places, (self._ideal.width, self._ideal.height))
