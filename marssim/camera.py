"""Cameras and stereo rigs, by their documented names. The code is in `marssim.base.camera`."""

from marssim.base.camera import (
    MAX_DEPTH,
    MIN_DEPTH,
    NATECAM,
    PinholeCamera,
    StereoRig,
    look_pose,
    rotate,
)

__all__ = ["MAX_DEPTH", "MIN_DEPTH", "NATECAM", "PinholeCamera", "StereoRig", "look_pose", "rotate"]
