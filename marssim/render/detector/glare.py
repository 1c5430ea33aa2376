"""Veiling glare: light that the lens scatters widely, seen as a halo around what is bright and as lost contrast."""

from __future__ import annotations

import cv2
import numpy as np

COARSE = 8  # [px] the halo is computed on an image so much smaller
WIDTHS = (0.01, 0.04, 0.16)  # standard deviations of the halo's parts, as shares of the image's width


def with_glare(radiance: np.ndarray, share: float) -> np.ndarray:
    """Return the radiance with a share of all light spread around where it belongs.

    The spread is a sum of Gaussians of growing width, close to the power law of scattering in lenses (Talvala, Adams,
    Horowitz and Levoy, "Veiling glare in high dynamic range imaging", ACM Trans. Graph. 26, 2007). What lies beyond the
    image's border counts as bright as the border.

    Args:
        radiance: (H, W, 3) float32.
        share: Share of the light that is scattered, 0 to 1.

    Returns:
        (H, W, 3) float32.
    """
    height, width = radiance.shape[:2]
    size = (max(1, width // COARSE), max(1, height // COARSE))
    small = cv2.resize(radiance, size, interpolation=cv2.INTER_AREA)
    parts = [cv2.GaussianBlur(small, (0, 0), part * size[0], borderType=cv2.BORDER_REPLICATE) for part in WIDTHS]
    halo = cv2.resize(np.mean(parts, axis=0), (width, height), interpolation=cv2.INTER_LINEAR)
    return cv2.addWeighted(radiance, 1 - share, halo, share, 0)
