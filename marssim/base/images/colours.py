"""Depth and normals as colours."""

from __future__ import annotations

import cv2
import numpy as np

from marssim.base.camera import MAX_DEPTH

NEAR = 1.0  # [m] depth at the warm end of the colours


def depth_colours(depth: np.ndarray, near: float = NEAR, far: float = MAX_DEPTH) -> np.ndarray:
    """(H, W, 3) uint8 RGB of depth (H, W) [m]: logarithmic, near is warm; grey beyond `far`, black where NaN."""
    z = np.where(np.isfinite(depth) & (depth > 0), depth, far)
    code = np.clip(np.log(far / z) / np.log(far / near), 0, 1)
    colours = cv2.applyColorMap((code * 255).astype(np.uint8), cv2.COLORMAP_TURBO)[..., ::-1].copy()
    colours[depth > far] = 90
    colours[np.isnan(depth)] = 0
    return colours


def normal_colours(normal: np.ndarray) -> np.ndarray:
    """(H, W, 3) uint8 RGB of camera-frame normals: x right, y up and towards the camera are bright; black where 0."""
    shown = normal * np.array([1, -1, -1], dtype=normal.dtype)
    colours = np.clip((np.nan_to_num(shown) + 1) * 127.5, 0, 255).astype(np.uint8)
    colours[(normal == 0).all(axis=-1) | ~np.isfinite(normal).all(axis=-1)] = 0
    return colours
