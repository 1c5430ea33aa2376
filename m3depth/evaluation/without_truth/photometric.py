"""How well a disparity explains the right image: the photometric residual, which needs no true depth.

Both images are grey, each less its local mean and over its local deviation (Gaussian, sigma 6 px). The right one is
warped to the left one by the disparity (cubic); the residual is the mean of |difference|. An error of half a pixel
raises it by a fifth to a third on rover images. It is compared with SGBM's on the same pixels.
"""

from __future__ import annotations

import cv2
import numpy as np

from m3depth.stereo.pairs import in_grey

SIGMA = 6.0  # [px] of the local mean and deviation
LEAST_DEVIATION = 1.0  # [grey levels] below which an image is taken for smooth
BORDER = 2  # [px] of the images that do not count


def normalised(image: np.ndarray) -> np.ndarray:
    """Return an image less its local mean and over its local deviation: (H, W) float32.

    Args:
        image: (H, W) or (H, W, 3) uint8.
    """
    grey = in_grey(image).astype(np.float32)
    mean = cv2.GaussianBlur(grey, (0, 0), SIGMA)
    variance = cv2.GaussianBlur(grey * grey, (0, 0), SIGMA) - mean * mean
    return (grey - mean) / np.sqrt(np.maximum(variance, LEAST_DEVIATION**2))


def residuals(left: np.ndarray, right: np.ndarray, disparity: np.ndarray) -> np.ndarray:
    """Return the photometric residual of each pixel, (H, W) float32.

    Args:
        left, right: (H, W) or (H, W, 3) uint8, rectified.
        disparity: (H, W) [px].

    Returns:
        NaN where the disparity is unknown or its match lies beyond the border.
    """
    height, width = disparity.shape
    rows, columns = np.mgrid[:height, :width].astype(np.float32)
    match = columns - disparity
    with np.errstate(invalid="ignore"):
        inside = (match >= BORDER) & (match <= width - 1 - BORDER)
    for edge in (np.s_[:BORDER], np.s_[-BORDER:], np.s_[:, :BORDER], np.s_[:, -BORDER:]):
        inside[edge] = False
    where = np.where(inside, match, 0).astype(np.float32)
    warped = cv2.remap(normalised(right), where, rows, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return np.where(inside, np.abs(normalised(left) - warped), np.float32(np.nan))
