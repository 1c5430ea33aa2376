"""Surface normals by planes that are fitted to a disparity map: the baseline that a learned normal has to beat."""

from __future__ import annotations

import cv2
import numpy as np

from marssim.camera import PinholeCamera

NORMAL_WINDOW = 15  # [px] side of the window that a normal is fitted in


def normals_from_disparity(disparity: np.ndarray, camera: PinholeCamera, window: int = NORMAL_WINDOW) -> np.ndarray:
    """Surface normals of a disparity map: the plane that fits a window best.

    A plane in space is a plane in disparity too: n . P = h gives d = a u + b v + c, and n ~ (a fx, b fy, c) if u and v
    are counted from the principal point. So the least-squares slopes of the disparity are all that is needed.
    disparity: (H, W) float [px]; window: odd [px]. Returns (H, W, 3) float32, unit length, facing the camera; towards
    the camera where disparity is 0 or NaN.
    """
    known = np.nan_to_num(disparity, nan=0.0, posinf=0.0, neginf=0.0).astype(np.float64)
    offset = np.arange(window) - window // 2
    slope = offset / (offset.astype(float) ** 2).sum()
    mean = np.full(window, 1 / window)
    a = cv2.sepFilter2D(known, -1, slope, mean, borderType=cv2.BORDER_REFLECT_101)
    b = cv2.sepFilter2D(known, -1, mean, slope, borderType=cv2.BORDER_REFLECT_101)
    centre = cv2.sepFilter2D(known, -1, mean, mean, borderType=cv2.BORDER_REFLECT_101)
    rays = camera.rays()
    u, v = rays[..., 0] * camera.fx, rays[..., 1] * camera.fy  # from the principal point
    normal = -np.stack([a * camera.fx, b * camera.fy, centre - a * u - b * v], axis=-1)
    away = (np.einsum("ijk,ijk->ij", normal, rays) >= 0) | (known <= 0)
    normal[away] = -rays[away]
    return (normal / np.linalg.norm(normal, axis=-1, keepdims=True)).astype(np.float32)
