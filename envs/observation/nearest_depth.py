"""The observed depth: small, and with no rock lost."""

from __future__ import annotations

import numpy as np

from marssim.base.camera import MAX_DEPTH


def nearest_depth(depth: np.ndarray, pixels: int) -> np.ndarray:
    """Shrink a depth map to pixels x pixels so that the nearest thing in each block stays.

    Args:
        depth: (H, W) depth [m], inf for sky; NaN and values that are not positive are unknown. H and W are multiples of
            `pixels`.
        pixels: Side of the result [px].

    Returns:
        float32 in [0, 15]: 15 for everything farther (sky too), 0 for blocks in which nothing is known.

    Raises:
        ValueError: If the depth does not divide into blocks.
    """
    h, w = depth.shape
    if h % pixels or w % pixels:
        raise ValueError(f"depth is {depth.shape}, which does not divide into {pixels} x {pixels} blocks")
    blocks = depth.reshape(pixels, h // pixels, pixels, w // pixels)
    unknown = ~(blocks > 0)  # NaN too; an estimator may be wrong in any way
    nearest = np.where(unknown, np.inf, blocks).min(axis=(1, 3))
    nearest = np.minimum(nearest, MAX_DEPTH)
    nearest[unknown.all(axis=(1, 3))] = 0
    return nearest.astype(np.float32)
