"""Write what a stereo rover sees, where it is, and what it decides, as a ROS 2 bag."""

from __future__ import annotations

import numpy as np

from marssim.base.bags import names
from marssim.base.bags.clouds import cloud_message
from marssim.base.bags.messages import (
    camera_info_message,
    disparity_message,
    frames_message,
    image_message,
    odometry_message,
    path_message,
    stamped_pose_message,
    text_message,
    twist_message,
)
from marssim.base.bags.writer import BagWriter
from marssim.base.camera import PinholeCamera, StereoRig

OPTICAL_IN_BODY = names.BODY_FROM_OPTICAL  # pose of an optical frame in its camera's frame


class StereoBagWriter(BagWriter):
    """A bag with the frames and topics of marssim.base.bags."""

    _baseline: float | None = None

    def write_images(self, stamp: int, left: np.ndarray, right: np.ndarray, rig: StereoRig) -> None:
        """Write a rectified pair and the CameraInfo of both eyes.

        Args:
            stamp: Time of the images [ns].
            left, right: (H, W) or (H, W, 3) uint8.
            rig: The cameras of these images.
        """
        eyes = (
            (names.LEFT_IMAGE, names.LEFT_INFO, names.LEFT_OPTICAL, left, 0.0),
            (names.RIGHT_IMAGE, names.RIGHT_INFO, names.RIGHT_OPTICAL, right, rig.baseline),
        )
        for image_topic, info_topic, frame, image, baseline in eyes:
            self.write(image_topic, stamp, image_message(stamp, frame, image))
            self.write(info_topic, stamp, camera_info_message(stamp, frame, rig.camera, baseline))

    def write_depth(
        self, stamp: int, depth: np.ndarray, camera: PinholeCamera, frame: str = names.LEFT_OPTICAL
    ) -> None:
        """Write a depth map of the left eye, and the camera at its size.

        Args:
            stamp: Time of the images [ns].
            depth: (H, W) [m]; inf is sky or too far, NaN is unknown.
            camera: The camera at that size.
            frame: Optical frame of the left eye.
        """
        self.write(names.DEPTH_IMAGE, stamp, image_message(stamp, frame, depth.astype(np.float32)))
        self.write(names.DEPTH_INFO, stamp, camera_info_message(stamp, frame, camera))

    def write_disparity(self, stamp: int, depth: np.ndarray, rig: StereoRig, frame: str = names.LEFT_OPTICAL) -> None:
        """Write a depth map (H, W) [m] of the left eye as DisparityImage; see disparity_message."""
        self.write(names.DISPARITY, stamp, disparity_message(stamp, frame, depth, rig))

    def write_cloud(self, stamp: int, points: np.ndarray, colours: np.ndarray, frame: str = names.LEFT_OPTICAL) -> None:
        """Write points (N, 3) [m] of a frame with their colours (N, 3) uint8 as PointCloud2."""
        self.write(names.POINTS, stamp, cloud_message(stamp, frame, points, colours))

    def write_pose(
        self,
        stamp: int,
        body: np.ndarray,
        camera: np.ndarray,
        baseline: float,
        believed: np.ndarray | None = None,
    ) -> None:
        """Write where the rover is: its true pose, its odometry, and all frames.

        Args:
            stamp: Time [ns].
            body: (4, 4) true pose of the rover, body to world.
            camera: (4, 4) true pose of the left camera, camera to world.
            baseline: Distance of the cameras [m].
            believed: (4, 4) pose of the rover as its odometry has it; None if it is the true one.
        """
        odometry = body if believed is None else believed
        self.write(names.TRUE_POSE, stamp, stamped_pose_message(stamp, names.MAP, body))
        self.write(names.ODOMETRY, stamp, odometry_message(stamp, names.ODOM, names.BASE_LINK, odometry))
        if baseline != self._baseline:
            self._baseline = baseline
            across = np.eye(4)
            across[1, 3] = -baseline
            fixed = [
                (names.LEFT_CAMERA, names.LEFT_OPTICAL, OPTICAL_IN_BODY),
                (names.LEFT_CAMERA, names.RIGHT_CAMERA, across),
                (names.RIGHT_CAMERA, names.RIGHT_OPTICAL, OPTICAL_IN_BODY),
            ]
            self.write(names.STATIC_FRAMES, stamp, frames_message(stamp, fixed), latched=True)
        mast = np.linalg.inv(body) @ camera @ np.linalg.inv(OPTICAL_IN_BODY)
        moving = [
            (names.MAP, names.ODOM, body @ np.linalg.inv(odometry)),
            (names.ODOM, names.BASE_LINK, odometry),
            (names.BASE_LINK, names.LEFT_CAMERA, mast),
        ]
        self.write(names.MOVING_FRAMES, stamp, frames_message(stamp, moving))

    def write_command(self, stamp: int, speed: float, yaw_rate: float) -> None:
        """Write a motion: speed forward [m/s], and yaw rate to the left [rad/s]."""
        self.write(names.COMMAND, stamp, twist_message(speed, yaw_rate))

    def write_status(self, stamp: int, status: str) -> None:
        """Write what the driver does, as nav.command.Command.status, or how the drive ended."""
        self.write(names.STATUS, stamp, text_message(status))

    def write_path(self, stamp: int, path: np.ndarray) -> None:
        """Write a planned path (N, 3) [m], in the frame of the odometry."""
        self.write(names.PATH, stamp, path_message(stamp, names.ODOM, path))

    def write_goal(self, stamp: int, place: np.ndarray) -> None:
        """Write the goal (3,) [m], in the frame of the map."""
        pose = np.eye(4)
        pose[:3, 3] = place
        self.write(names.GOAL, stamp, stamped_pose_message(stamp, names.MAP, pose))
