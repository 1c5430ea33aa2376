"""Textured planes as stereo samples whose ground truth is known in closed form."""

from __future__ import annotations

import cv2
import numpy as np

from marssim.base.camera import PinholeCamera, StereoRig
from marssim.base.dataset.sample import StereoSample


def plane_sample(
    seed: int, height: int = 64, width: int = 96, focal: float = 100.0, baseline: float = 0.27
) -> StereoSample:
    """A textured plane n . X = -h below a sky; the right image is drawn, the left one is looked up in it."""
    rng = np.random.default_rng(seed)
    rig = StereoRig(PinholeCamera.centred(width, height, focal), baseline)
    normal = np.array([rng.uniform(-0.2, 0.2), -1.0, rng.uniform(-0.6, -0.2)])
    normal /= np.linalg.norm(normal)
    facing = -(rig.camera.rays() @ normal)
    ground = facing > 0.06
    depth = np.where(ground, 1.2 / np.where(ground, facing, 1), np.inf).astype(np.float32)
    disparity = rig.depth_to_disparity(depth)
    right = cv2.GaussianBlur(rng.integers(0, 256, (height, width, 3), dtype=np.uint8), (0, 0), 1.0)
    u, v = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    left = cv2.remap(right, u - disparity, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    left[~ground] = right[~ground] = 200
    rock = np.zeros((height, width), np.int32)
    rock[height // 2 : height // 2 + 8, 10:18] = 1
    return StereoSample(
        left, right, depth, disparity, np.where(ground[..., None], normal, 0).astype(np.float32),
        (depth >= 0.5) & (depth <= 15), u - disparity < 0, rock, rig, {},
    )  # fmt: skip
