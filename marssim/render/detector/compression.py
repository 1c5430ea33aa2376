"""Lossy compression of the images before they are sent."""

from __future__ import annotations

import cv2
import numpy as np

LARGEST_JPEG = 65500  # [px] width and height that the encoder takes


def sent(image: np.ndarray, quality: int) -> np.ndarray:
    """Return an image after JPEG, as its receiver decodes it.

    Colour has half of the columns (4:2:2), as in images of Mastcam-Z, whose labels note a quality of 85.

    Args:
        image: (H, W, 3) uint8 RGB.
        quality: Quality of the JPEG, 1 to 99.

    Returns:
        (H, W, 3) uint8 RGB.
    """
    colour = [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_422]
    code = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality, *colour])[1]
    decoded = cv2.imdecode(code, cv2.IMREAD_COLOR)
    assert decoded is not None  # it was encoded above
    return np.ascontiguousarray(decoded[..., ::-1])
