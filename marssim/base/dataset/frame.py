"""A rendered stereo pair with its ground truth, before it is written."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from marssim.base.camera import StereoRig

SKY = -1
GROUND = 0  # rock n of Scene.rocks has id n + 1


@dataclass(frozen=True)
class StereoFrame:
    """What the rig sees. Maps are of the left eye; frame: left camera, x right, y down, z forward.

    left, right: (H, W, 3) uint8 RGB. depth: (H, W) float32 [m], inf in the sky. disparity: (H, W) float32 [px], 0 in
    the sky. normal: (H, W, 3) float32. surface: (H, W) int32 ids of GBuffer. occluded: (H, W) bool, left pixels whose
    point the right eye does not see. rig; pose: (4, 4) left camera to world.
    """

    left: np.ndarray
    right: np.ndarray
    depth: np.ndarray
    disparity: np.ndarray
    normal: np.ndarray
    surface: np.ndarray
    occluded: np.ndarray
    rig: StereoRig
    pose: np.ndarray
