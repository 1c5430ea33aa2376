"""Show depth and normals as colours, which are the same in every figure, contact sheet and film.

Near is bright yellow, far is dark violet, and each ratio of depths takes the same share of the colours (a logarithmic
scale). Disparity, which is large where things are near, has the same colours the other way round.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import cv2
import numpy as np

from marssim.base.camera import MAX_DEPTH

DEPTH_MAP = "viridis_r"  # matplotlib's name for the colours of depth
DISPARITY_MAP = "viridis"  # matplotlib's name for the colours of disparity
NEAR = 1.0  # [m] depth at the bright end of a fixed scale
TICKS = (1, 2, 3, 5, 10, 15)  # [m] depths that are labelled on a fixed scale
ROUND = (1, 1.5, 2, 3, 4, 5, 7)  # first digits of the depths that are labelled on another scale
# [m] depths that the bar of a scale may name which is chosen by what a map shows
DEPTH_TICKS = (0.05, 0.07, 0.1, 0.15, 0.2, 0.3, 0.5, 0.7, 1, 2, 3, 5, 10, 15, 30, 50, 100, 200, 500)
BEYOND = 90  # grey level of the sky, and of depth beyond the dark end
DEPTH_TITLE = f"depth: {NEAR:g} m yellow to {MAX_DEPTH:g} m violet, grey beyond"
NORMAL_TITLE = "normals: red right, green up, blue to the camera"
CONFIDENCE_TITLE = "confidence: 0 blue to 1 yellow"


def depth_colours(depth: np.ndarray, near: float = NEAR, far: float = MAX_DEPTH) -> np.ndarray:
    """Return depth as colours, on a logarithmic scale.

    Args:
        depth: (H, W) [m]; inf in the sky, NaN where it is unknown.
        near: Depth of the bright end [m].
        far: Depth of the dark end [m].

    Returns:
        (H, W, 3) uint8 RGB; grey beyond `far`, black where depth is unknown.
    """
    z = np.where(np.isfinite(depth) & (depth > 0), depth, far)
    share = np.clip(np.log(far / z) / np.log(far / near), 0, 1)
    colours = cv2.applyColorMap((share * 255).astype(np.uint8), cv2.COLORMAP_VIRIDIS)[..., ::-1].copy()
    colours[depth > far] = BEYOND
    colours[np.isnan(depth)] = 0
    return colours


def normal_colours(normal: np.ndarray) -> np.ndarray:
    """Return camera-frame normals as colours: red to the right, green up, blue to the camera.

    Args:
        normal: (H, W, 3) unit vectors, x right, y down, z forward; 0 or NaN where they are unknown.

    Returns:
        (H, W, 3) uint8 RGB; black where the normal is unknown.
    """
    shown = normal * np.array([1, -1, -1], dtype=normal.dtype)
    colours = np.clip((np.nan_to_num(shown) + 1) * 127.5, 0, 255).astype(np.uint8)
    colours[(normal == 0).all(axis=-1) | ~np.isfinite(normal).all(axis=-1)] = 0
    return colours


def confidence_colours(confidence: np.ndarray) -> np.ndarray:
    """Return confidence as colours, from blue at 0 to yellow at 1 (cividis).

    Args:
        confidence: (H, W), 0 to 1; NaN counts as 0.

    Returns:
        (H, W, 3) uint8 RGB.
    """
    share = np.nan_to_num(np.clip(confidence, 0, 1))
    return cv2.applyColorMap((share * 255).astype(np.uint8), cv2.COLORMAP_CIVIDIS)[..., ::-1].copy()


def depth_ticks(depths: Iterable[np.ndarray]) -> tuple[float, ...]:
    """Return the depths [m] to label on a scale for some maps of depth; the first and the last are its ends.

    They are TICKS, unless all that the maps show is nearer: then they are round depths around what they show.

    Args:
        depths: Maps of depth [m]; inf in the sky, NaN where it is unknown.
    """
    valid = [depth[np.isfinite(depth) & (depth > 0)] for depth in depths]
    near = min((float(depth.min()) for depth in valid if depth.size), default=NEAR)
    far = max((float(depth.max()) for depth in valid if depth.size), default=MAX_DEPTH)
    if far > NEAR:
        return TICKS
    rounded = [digit * 10.0**power for power in range(math.floor(math.log10(near) - 1e-9), 1) for digit in ROUND]
    first = max(tick for tick in rounded if tick <= near)
    last = min(tick for tick in rounded if tick >= far and tick > first)
    return tuple(tick for tick in rounded if first <= tick <= last)


def depth_bar(width: int, height: int = 12, ticks: Sequence[float] = TICKS) -> tuple[np.ndarray, list[int]]:
    """Draw the scale of `depth_colours`, with the near end on the left.

    Args:
        width: Width of the bar [px].
        height: Height of the bar [px].
        ticks: Depths that are labelled [m], as of `depth_ticks`; the first and the last are the ends.

    Returns:
        (height, width, 3) uint8 RGB, and the column of each of the ticks.
    """
    near, far = ticks[0], ticks[-1]
    depth = np.geomspace(near, far, width)
    columns = [round((width - 1) * float(np.log(tick / near) / np.log(far / near))) for tick in ticks]
    return np.repeat(depth_colours(depth[None], near, far), height, axis=0), columns
