"""A rendered stereo pair with its ground truth, as it is before it is written to a dataset."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from marssim.base.camera import StereoRig

ROVER = -2  # id of the rover that carries the cameras in maps of surfaces
SKY = -1  # id of the sky
GROUND = 0  # id of the ground; body n of Scene.bodies (rocks, slabs, ledges, fragments) has the id n + 1


@dataclass(frozen=True)
class StereoFrame:
    """A rendered stereo pair with its ground truth. Maps are of the left eye.

    Vectors are in the frame of the left camera: x right, y down, z forward.

    Attributes:
        left: (H, W, 3) uint8 RGB image of the left eye.
        right: (H, W, 3) uint8 RGB image of the right eye.
        depth: (H, W) float32 [m] along the optical axis; inf in the sky.
        disparity: (H, W) float32 [px], x_left - x_right as the images show it; 0 in the sky. It is f B / depth where
            `right_rotation` is the identity.
        normal: (H, W, 3) float32 unit normals that face the camera; 0 in the sky.
        surface: (H, W) int32 id of the surface: SKY, GROUND, ROVER, or n + 1 for body n of Scene.bodies.
        occluded: (H, W) bool, true where the right eye does not see the point.
        rig: The cameras.
        pose: (4, 4) left camera to world.
        right_rotation: (3, 3) frame of the right camera, as the image was taken, to that of the rig's right camera.
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
    right_rotation: np.ndarray = field(default_factory=lambda: np.eye(3))
