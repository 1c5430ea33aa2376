"""Pairs of a textured slope whose right camera is turned by a known amount."""

import cv2
import numpy as np

from marssim.base.camera import PinholeCamera, StereoRig

W, H = 320, 256
RIG = StereoRig(PinholeCamera.centred(W, H, 380.0), 0.27)


def turned(image: np.ndarray, rig: StereoRig, offset: float, rotation: float, scale: float = 0.0) -> np.ndarray:
    """What a right camera sees that is turned up by `offset` px and about its axis, and that magnifies."""
    camera = rig.camera
    pitch, _ = cv2.Rodrigues(np.array([-np.arctan(offset / camera.fy), 0.0, 0.0]))
    roll, _ = cv2.Rodrigues(np.array([0.0, 0.0, rotation]))
    to_given = camera.K @ np.diag([1 + scale, 1 + scale, 1]) @ roll @ pitch @ np.linalg.inv(camera.K)
    size = (camera.width, camera.height)
    return cv2.warpPerspective(image, to_given, size, flags=cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REFLECT_101)


def slope_disparity(rig: StereoRig) -> np.ndarray:
    """The disparity of the slope, (H, W) float32 [px]."""
    v = np.arange(rig.camera.height, dtype=np.float32)[:, None]
    return np.repeat((8 + 52 * v / rig.camera.height) * rig.camera.width / W, rig.camera.width, axis=1)


def slope(seed: int = 0, rig: StereoRig = RIG, blur: float = 1.5) -> tuple[np.ndarray, np.ndarray]:
    """A textured ground plane, seen by an ideal rig: disparities of 8 to 60 px, more in the lower rows."""
    width, height = rig.camera.width, rig.camera.height
    noise = np.random.default_rng(seed).normal(size=(height, 2 * width)).astype(np.float32)
    texture = cv2.normalize(cv2.GaussianBlur(noise, (0, 0), blur), None, 0, 255, cv2.NORM_MINMAX)
    left = texture[:, :width]
    u, v = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    disparity = slope_disparity(rig)
    right = cv2.remap(texture, u + disparity, v, cv2.INTER_LANCZOS4)
    return left.astype(np.uint8), np.clip(right, 0, 255).astype(np.uint8)
