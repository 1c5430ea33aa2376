"""Poses of the left camera: files of them, samples that record them, and the frames of the rover and of the world.

World and rover: z up. Camera: x right, y down, z forward. A pose is a (4, 4) matrix, camera to world [m].
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import scipy

from m3depth.prediction.options import PredictOptions
from m3depth.rectification.files import rig_beside
from marssim.base.calibration.bounded_text import read_text
from marssim.base.dataset.sample import recorded_mount
from marssim.base.files.json_file import DatasetError, read_json
from marssim.base.pose import FARTHEST, ROVER_KEY, recorded_pose
from marssim.base.rover_spec import ZHURONG, CameraMount

ASSUMED_KEY = "mount_assumed"  # in prediction.json: whether nothing says where the camera is on the rover
MOUNT_ASSUMED = (
    f"nothing says where the cameras are on the rover: {ZHURONG.mount.x:g} m ahead of its origin, "
    f"{ZHURONG.mount.height:g} m above the ground and {np.rad2deg(ZHURONG.mount.pitch):.0f} degrees down, "
    "as on Zhurong, are assumed; give --mount"
)
LOOKS_UP = 0.94  # z of the optical axis of a camera that looks up by 70 deg
MOST_BYTES = 400_000_000  # of a file of poses, 200 to 300 each
TOLERANCE = 0.01  # by which R R^T of a file's rotation may differ from 1


def mounted_camera_pose(mount: tuple[float, float, float], baseline: float) -> np.ndarray:
    """Return the pose of the left camera on the rover: (4, 4) camera to rover.

    Args:
        mount: Metres ahead of the rover's origin, metres above the ground, and degrees that the cameras look down.
        baseline: Distance of the cameras [m]; the origin lies midway between them.
    """
    return CameraMount.of_flag(mount).left_eye(baseline)


def rolled(pose: np.ndarray, baseline: float, raw_frame: np.ndarray) -> np.ndarray:
    """Return the pose of a rectified left camera, on a rover or in a world where the raw cameras have no roll.

    The cameras stay where their middle is, and look where they look. Their row of pixels leads from one to the other,
    which a vertical offset between them tilts.

    Args:
        pose: (4, 4) pose of the left camera if it had no roll.
        baseline: Distance of the cameras [m].
        raw_frame: (4, 4) rectified left camera to the raw one.
    """
    x, y = raw_frame[:2, 0] / np.hypot(*raw_frame[:2, 0])
    turn, middle = np.eye(4), np.eye(4)
    turn[:2, :2] = [[x, -y], [y, x]]
    middle[0, 3] = baseline / 2
    return np.asarray(pose @ middle @ turn @ np.linalg.inv(middle))


def rover_pose(options: PredictOptions, image: Path, baseline: float, recorded: np.ndarray | None = None) -> np.ndarray:
    """Return the pose of the left camera on the rover: by --mount, or else what a bag, a label or a sample records, or
    else the rig file, or Zhurong's.

    Args:
        options: The command's flags.
        image: The left image, beside which m3depth.rectify may have written the rig file.
        baseline: Distance of the cameras [m].
        recorded: (4, 4) what a bag, a label or a sample says.

    Returns:
        (4, 4) camera to rover.

    Raises:
        DatasetError: The rig file holds something else than a pose.
    """
    pose = given_rover_pose(options, image, baseline, recorded)
    return ZHURONG.mount.left_eye(baseline) if pose is None else pose


def given_rover_pose(
    options: PredictOptions, image: Path, baseline: float, recorded: np.ndarray | None = None
) -> np.ndarray | None:
    """Return what rover_pose returns, or None where it would be Zhurong's. Arguments and errors are those of it."""
    if options.mount is not None:
        return mounted_camera_pose(options.mount, baseline)
    if recorded is not None:
        return recorded
    file = options.calib[0] if options.calib else rig_beside(image)
    content = read_json(file).get(ROVER_KEY) if file.suffix == ".json" and file.is_file() else None
    if content is None:
        return None
    try:
        return recorded_pose(content)
    except ValueError as error:
        raise DatasetError(f"{file}: {ROVER_KEY}: {error}") from None


def sample_pose(file: Path) -> np.ndarray | None:
    """Return the pose that sample.json records; None if it has none. Raises DatasetError that names the file."""
    recorded = read_json(file).get("pose")
    try:
        return None if recorded is None else recorded_pose(recorded)
    except ValueError as error:
        raise DatasetError(f"{file}: {error}") from None


def sample_mount(file: Path) -> np.ndarray | None:
    """Return the pose of the left camera on the rover by sample.json, as recorded_mount. Raises DatasetError."""
    try:
        return recorded_mount(read_json(file))
    except ValueError as error:
        raise DatasetError(f"{file}: {error}") from None


def read_poses(path: Path, axes: str) -> np.ndarray:
    """Read a file of poses, with a line for each pair; empty lines and lines that begin with # do not count.

    Poses that begin at the first camera and have its axes, as those of visual odometry, are a warning where a world
    with z up is expected: there, that camera looks up at the zenith.

    Args:
        path: Lines of 12 numbers, the rows of [R t] (KITTI's odometry), or of 8: time, position and the quaternion x y
            z w (TUM).
        axes: Those of the world: "z-up", or "camera" for those of the first camera.

    Returns:
        (N, 4, 4).

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: A line is none of these; the message names file and line.
    """
    poses = []
    for number, line in enumerate(read_text(path, "file of poses", MOST_BYTES).splitlines(), 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        try:
            values = np.array([float(word) for word in line.replace(",", " ").split()])
        except ValueError:
            values = np.zeros(0)
        if len(values) not in (8, 12) or not np.isfinite(values).all():
            raise ValueError(
                f"{path}, line {number}: expected 12 numbers (KITTI) or 8 (TUM), got {line.strip()[:60]!r}"
            )
        pose = np.eye(4)
        if len(values) == 12:
            pose[:3] = values.reshape(3, 4)
            turn = pose[:3, :3]
            sound = np.abs(turn).max() < 2 and np.abs(turn @ turn.T - np.eye(3)).max() < TOLERANCE
            sound = sound and np.linalg.det(turn) > 0
        else:
            sound = np.abs(values[4:]).max() < 2 and abs(float(np.linalg.norm(values[4:])) - 1) < TOLERANCE
            if sound:
                pose[:3, :3] = scipy.spatial.transform.Rotation.from_quat(values[4:]).as_matrix()
            pose[:3, 3] = values[1:4]
        if not sound:
            raise ValueError(f"{path}, line {number}: holds no rotation")
        if np.abs(pose[:3, 3]).max() > FARTHEST:
            raise ValueError(
                f"{path}, line {number}: lies over {FARTHEST:g} m from the origin; subtract one near the drive "
                "(nav.map --origin adds it again)"
            )
        poses.append(pose)
    if axes == "z-up" and poses and poses[0][2, 2] > LOOKS_UP:
        print(
            f"warning: {path}: the first camera looks up at the zenith, in a world with z up; if the poses have the "
            "axes of the first camera, give --pose-axes camera",
            file=sys.stderr,
        )
    return np.array(poses).reshape(-1, 4, 4)
