"""Messages of ROS made of arrays: images, cameras, disparity, poses and commands.

Stamps are nanoseconds, poses (4, 4) matrices.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy

from marssim.base.bags.library import new_message
from marssim.base.camera import PinholeCamera, StereoRig

SECOND = 1_000_000_000  # [ns]
UNKNOWN_DISPARITY = -1.0  # below DisparityImage.min_disparity, as stereo_image_proc marks it


def header(stamp: int, frame: str) -> Any:
    """Return the header of a message.

    Args:
        stamp: Time [ns].
        frame: Name of the frame.
    """
    seconds, rest = divmod(int(stamp), SECOND)
    time = new_message("builtin_interfaces/Time", sec=seconds, nanosec=rest)
    return new_message("std_msgs/Header", stamp=time, frame_id=frame)


def image_message(stamp: int, frame: str, image: np.ndarray) -> Any:
    """Return a sensor_msgs/Image.

    Args:
        stamp: Time [ns].
        frame: Optical frame of the camera.
        image: (H, W, 3) uint8 RGB (rgb8), (H, W) uint8 (mono8) or (H, W) float32 (32FC1).
    """
    encoding = "rgb8" if image.ndim == 3 else "mono8" if image.dtype == np.uint8 else "32FC1"
    values = np.ascontiguousarray(image, "<f4" if encoding == "32FC1" else np.uint8)
    height, width = image.shape[:2]
    return new_message(
        "sensor_msgs/Image", header=header(stamp, frame), height=height, width=width, encoding=encoding,
        is_bigendian=0, step=values.nbytes // height, data=values.reshape(-1).view(np.uint8),
    )  # fmt: skip


def camera_info_message(stamp: int, frame: str, camera: PinholeCamera, baseline: float = 0.0) -> Any:
    """Return the sensor_msgs/CameraInfo of a rectified camera: no distortion, no rotation, the whole image.

    Args:
        stamp: Time [ns].
        frame: Optical frame of the camera.
        camera: The camera.
        baseline: How far the camera stands to the right of the left one [m], which makes P[0, 3] = -f B.
    """
    projection = np.column_stack([camera.K, [-camera.fx * baseline, 0.0, 0.0]])
    return new_message(
        "sensor_msgs/CameraInfo", header=header(stamp, frame), height=camera.height, width=camera.width,
        distortion_model="plumb_bob", d=np.zeros(5), k=camera.K.ravel(), r=np.eye(3).ravel(), p=projection.ravel(),
        binning_x=0, binning_y=0, roi=_region(0, 0, 0, 0, False),
    )  # fmt: skip


def disparity_message(stamp: int, frame: str, depth: np.ndarray, rig: StereoRig) -> Any:
    """Return the stereo_msgs/DisparityImage of a depth map: Z = f T / d. Sky has d = 0, and unknown pixels -1.

    Args:
        stamp: Time [ns].
        frame: Optical frame of the left camera.
        depth: (H, W) [m]; inf is sky or too far, NaN is unknown.
        rig: The cameras.
    """
    disparity = np.where(np.isnan(depth), UNKNOWN_DISPARITY, rig.depth_to_disparity(depth)).astype(np.float32)
    height, width = depth.shape
    return new_message(
        "stereo_msgs/DisparityImage", header=header(stamp, frame), image=image_message(stamp, frame, disparity),
        f=rig.camera.fx, t=rig.baseline, valid_window=_region(0, 0, height, width, False), min_disparity=0.0,
        max_disparity=float(max(disparity.max(), 0.0)), delta_d=0.0,
    )  # fmt: skip


def pose_message(pose: np.ndarray) -> Any:
    """Return the geometry_msgs/Pose of a (4, 4) pose."""
    position = new_message("geometry_msgs/Point", **_xyz(pose[:3, 3]))
    return new_message("geometry_msgs/Pose", position=position, orientation=_quaternion(pose))


def stamped_pose_message(stamp: int, frame: str, pose: np.ndarray) -> Any:
    """Return a geometry_msgs/PoseStamped of a (4, 4) pose in a frame."""
    return new_message("geometry_msgs/PoseStamped", header=header(stamp, frame), pose=pose_message(pose))


def odometry_message(stamp: int, frame: str, child: str, pose: np.ndarray) -> Any:
    """Return a nav_msgs/Odometry without a twist: the pose of `child` in `frame`, (4, 4). Unknown covariances are 0."""
    with_covariance = new_message("geometry_msgs/PoseWithCovariance", pose=pose_message(pose), covariance=np.zeros(36))
    twist = new_message("geometry_msgs/TwistWithCovariance", twist=twist_message(0.0, 0.0), covariance=np.zeros(36))
    return new_message(
        "nav_msgs/Odometry", header=header(stamp, frame), child_frame_id=child, pose=with_covariance, twist=twist
    )


def twist_message(speed: float, yaw_rate: float) -> Any:
    """Return a geometry_msgs/Twist: speed forward [m/s], and yaw rate to the left [rad/s]."""
    linear, angular = (new_message("geometry_msgs/Vector3", **_xyz(v)) for v in ((speed, 0, 0), (0, 0, yaw_rate)))
    return new_message("geometry_msgs/Twist", linear=linear, angular=angular)


def path_message(stamp: int, frame: str, path: np.ndarray) -> Any:
    """Return a nav_msgs/Path of points (N, 3) [m], each with the heading of its way to the next one."""
    poses = []
    for number, place in enumerate(path):
        pose = np.eye(4)
        pose[:3, 3] = place
        after = path[min(number + 1, len(path) - 1)] - path[max(min(number, len(path) - 2), 0)]
        pose[:3, :3] = scipy.spatial.transform.Rotation.from_euler("z", np.arctan2(after[1], after[0])).as_matrix()
        poses.append(stamped_pose_message(stamp, frame, pose))
    return new_message("nav_msgs/Path", header=header(stamp, frame), poses=poses)


def text_message(text: str) -> Any:
    """Return a std_msgs/String."""
    return new_message("std_msgs/String", data=text)


def frames_message(stamp: int, frames: Sequence[tuple[str, str, np.ndarray]]) -> Any:
    """Return a tf2_msgs/TFMessage.

    Args:
        stamp: Time [ns].
        frames: Parent, child, and the (4, 4) pose of the child in the parent.
    """
    transforms = []
    for parent, child, pose in frames:
        translation = new_message("geometry_msgs/Vector3", **_xyz(pose[:3, 3]))
        transform = new_message("geometry_msgs/Transform", translation=translation, rotation=_quaternion(pose))
        transforms.append(
            new_message(
                "geometry_msgs/TransformStamped", header=header(stamp, parent), child_frame_id=child,
                transform=transform,
            )
        )  # fmt: skip
    return new_message("tf2_msgs/TFMessage", transforms=transforms)


def _region(x: int, y: int, height: int, width: int, rectify: bool) -> Any:
    return new_message(
        "sensor_msgs/RegionOfInterest", x_offset=x, y_offset=y, height=height, width=width, do_rectify=rectify
    )


def _xyz(values: Sequence[float] | np.ndarray) -> dict[str, float]:
    return dict(zip("xyz", map(float, values), strict=True))


def _quaternion(pose: np.ndarray) -> Any:
    values = scipy.spatial.transform.Rotation.from_matrix(pose[:3, :3]).as_quat(canonical=True)
    return new_message("geometry_msgs/Quaternion", **dict(zip("xyzw", map(float, values), strict=True)))
