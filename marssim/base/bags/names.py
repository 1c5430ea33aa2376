"""The frames and the topics of the bags that this project writes."""

from __future__ import annotations

import numpy as np

MAP, ODOM, BASE_LINK = "map", "odom", "base_link"
LEFT_CAMERA, RIGHT_CAMERA = "left_camera", "right_camera"
LEFT_OPTICAL, RIGHT_OPTICAL = "left_camera_optical", "right_camera_optical"

LEFT_IMAGE, RIGHT_IMAGE = "/stereo/left/image_rect", "/stereo/right/image_rect"
LEFT_INFO, RIGHT_INFO = "/stereo/left/camera_info", "/stereo/right/camera_info"
DEPTH_IMAGE, DEPTH_INFO = "/stereo/depth/image_rect", "/stereo/depth/camera_info"
DISPARITY, POINTS = "/stereo/disparity", "/stereo/points2"
TRUE_POSE, ODOMETRY = "/ground_truth/pose", "/odom"
COMMAND, STATUS, PATH, GOAL = "/cmd_vel", "/navigator/status", "/navigator/path", "/navigator/goal"
MOVING_FRAMES, STATIC_FRAMES = "/tf", "/tf_static"

BODY_FROM_OPTICAL = np.array([[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""(4, 4) optical frame of a camera (x right, y down, z forward) to its frame with x forward, y left, z up."""
