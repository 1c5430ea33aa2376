"""Cameras and stereo rigs by their documented names; `marssim.base.camera` holds the code."""

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
