import json

import numpy as np
import pytest

from m3depth.prediction.options import PredictOptions
from m3depth.prediction.sources.poses import mounted_camera_pose, read_poses, rolled, rover_pose
from marssim.base.rover_spec import ZHURONG


def test_kitti_and_tum_lines_give_the_same_pose(tmp_path):
    file = tmp_path / "poses.txt"
    file.write_text("# a turn by 90 deg about z\n0 -1 0 1 1 0 0 2 0 0 1 3\n\n12.5 1 2 3 0 0 0.70710678 0.70710678\n")
    first, second = read_poses(file, "camera")
    np.testing.assert_allclose(first, second, atol=1e-7)
    np.testing.assert_allclose(first @ [1, 0, 0, 1], [1, 3, 3, 1], atol=1e-7)


def test_a_file_of_poses_may_be_larger_than_one_of_a_calibration(tmp_path):
    (tmp_path / "poses.txt").write_text(f"# {'long ' * 900_000}\n0 0 0 0 0 0 0 1\n")
    assert len(read_poses(tmp_path / "poses.txt", "camera")) == 1


@pytest.mark.parametrize(
    ("axes", "line", "warned"),
    [
        ("z-up", "0 0 0 0 0 0 0 1", True),
        ("camera", "0 0 0 0 0 0 0 1", False),
        ("z-up", "0 1 2 3 -0.5 0.5 -0.5 0.5", False),
    ],
)
def test_poses_with_the_axes_of_the_first_camera_are_a_warning_in_a_world(tmp_path, capsys, axes, line, warned):
    (tmp_path / "poses.txt").write_text(line)
    assert len(read_poses(tmp_path / "poses.txt", axes)) == 1
    error = capsys.readouterr().err
    assert (error == "") != warned and error.startswith(f"warning: {tmp_path / 'poses.txt'}: the first c" * warned)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("1 2 3", r"line 2: expected 12 numbers \(KITTI\) or 8 \(TUM\), got '1 2 3'"),
        ("a b c d e f g h", "line 2: expected 12"),
        ("0 0 0 0 0 0 0 nan", "line 2: expected 12"),
        ("0 1 2 3 0 0 0 0", "line 2: holds no rotation"),
        ("2 0 0 0 0 2 0 0 0 0 2 0", "line 2: holds no rotation"),
        ("1e300 0 0 0 0 1 0 0 0 0 1 0", "line 2: holds no rotation"),
        ("0 1 2 3 1e300 0 0 0", "line 2: holds no rotation"),
        ("-1 0 0 0 0 1 0 0 0 0 1 0", "line 2: holds no rotation"),
        ("0 5e5 4.1e6 3 0 0 0 1", r"line 2: lies over 1e\+06 m from the origin; subtract one near the drive"),
    ],
)
def test_a_line_that_is_no_pose_is_named(tmp_path, line, message):
    (tmp_path / "p.txt").write_text(f"0 0 0 0 0 0 0 1\n{line}\n")
    with pytest.raises(ValueError, match=f"p.txt, {message}"):
        read_poses(tmp_path / "p.txt", "z-up")


def test_the_rover_looks_ahead_and_down():
    pose = mounted_camera_pose((0.5, 2.0, 30.0), baseline=0.4)
    np.testing.assert_allclose(pose[:3, 3], [0.5, 0.2, 2.0])
    np.testing.assert_allclose(pose[:3, 2], [np.cos(np.pi / 6), 0, -0.5], atol=1e-12)  # the optical axis
    np.testing.assert_allclose(pose[:3, 0], [0, -1, 0], atol=1e-12)  # right of the camera is right of the rover


def test_the_rig_file_places_the_camera_unless_a_flag_does(tmp_path):
    image, pose = tmp_path / "left.png", mounted_camera_pose((1.0, 1.9, 33.0), 0.4)
    options = PredictOptions((image, tmp_path / "right.png"), tmp_path)
    np.testing.assert_array_equal(rover_pose(options, image, 0.3), ZHURONG.mount.left_eye(0.3))
    (tmp_path / "rig.json").write_text(json.dumps({"camera_to_rover": pose.tolist()}))
    np.testing.assert_array_equal(rover_pose(options, image, 0.3), pose)
    given = PredictOptions(options.images, tmp_path, mount=(0.0, 1.0, 0.0))
    assert rover_pose(given, image, 0.3)[2, 3] == 1.0
    (tmp_path / "rig.json").write_text('{"camera_to_rover": [1, 2]}')
    with pytest.raises(ValueError, match=r"rig.json: camera_to_rover: pose must be 4 rows of 4 finite numbers"):
        rover_pose(options, image, 0.3)


def test_a_vertical_offset_of_level_raw_cameras_rolls_the_rectified_ones_about_their_middle():
    level, baseline, angle = mounted_camera_pose((0.5, 1.2, 20.0), 0.4), 0.4, 0.2
    raw_frame = np.eye(4)
    raw_frame[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    pose = rolled(level, baseline, raw_frame)
    raw = pose @ np.linalg.inv(raw_frame)
    np.testing.assert_allclose(raw[:3, :3], level[:3, :3], atol=1e-12)  # whose rows are level
    np.testing.assert_allclose(pose @ [0.2, 0, 0, 1], level @ [0.2, 0, 0, 1], atol=1e-12)
    assert abs(pose[2, 0]) > 0.15  # the right eye lies lower
