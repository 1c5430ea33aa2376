"""Cameras, stereo rigs and poses, by their documented names. The code is in `marssim.base`."""

from marssim.base.camera import MAX_DEPTH, MIN_DEPTH, NATECAM, PinholeCamera, StereoRig
from marssim.base.pose import look_pose, rotate

__all__ = ["MAX_DEPTH", "MIN_DEPTH", "NATECAM", "PinholeCamera", "StereoRig", "look_pose", "rotate"]
