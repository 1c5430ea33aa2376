import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from marssim.base.pose import look_pose, planar_pose, recorded_pose, rigid_pose, rotate
from marssim.physics.state import rotation


@given(st.floats(-3, 3), st.floats(-1.2, 1.2), st.floats(-1, 1))
def test_a_look_pose_is_a_rotation_that_looks_along_its_angles(yaw, pitch, roll):
    pose = look_pose(np.zeros(3), yaw, pitch, roll)
    turn = pose[:3, :3]
    assert np.allclose(turn @ turn.T, np.eye(3))
    assert np.linalg.det(turn) == pytest.approx(1)
    assert np.allclose(turn[:, 2], [np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), -np.sin(pitch)])
    if roll == 0:
        assert turn[2, 0] == pytest.approx(0)  # the x axis stays level
        assert turn[2, 1] < 0  # image down is world down


@given(st.floats(-3.1, 3.1), st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))
def test_a_planar_pose_is_where_a_body_stands_and_where_its_x_axis_points(yaw, pitch, roll):
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation(roll, pitch, yaw), (3.0, -4.0, 1.0)
    x, y, heading = planar_pose(pose)
    assert (x, y) == (3.0, -4.0) and heading == pytest.approx(yaw)
    ahead = pose[:2, 0] / np.hypot(*pose[:2, 0])
    assert np.allclose(ahead, [np.cos(heading), np.sin(heading)])


def test_positive_roll_turns_the_camera_clockwise():
    right = look_pose(np.zeros(3), 0, 0, np.deg2rad(10))[:3, 0]
    assert right[2] < 0  # its right side sinks


@pytest.mark.parametrize("shape", [(0, 3), (3,), (5, 3), (4, 5, 3)])
@pytest.mark.parametrize("rows", [2, 3])
def test_rotated_vectors_are_those_of_a_matrix_product(shape, rows):
    rng = np.random.default_rng(0)
    vectors, matrix = rng.normal(size=shape), rng.normal(size=(rows, 3))
    assert rotate(vectors, matrix).shape == (*shape[:-1], rows)
    assert np.allclose(rotate(vectors, matrix), vectors @ matrix.T)


def test_a_recorded_pose_comes_back():
    pose = look_pose(np.array([3.0, -4.0, 1.2]), 0.3, 0.2, 0.1)
    assert np.array_equal(recorded_pose(pose.tolist()), pose)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda pose: None, "4 rows of 4 finite numbers"),
        (lambda pose: pose[:3], "4 rows of 4 finite numbers"),
        (lambda pose: [["a"] * 4] * 4, "4 rows of 4 finite numbers"),
        (lambda pose: [[10**400, 0, 0, 0], *pose[1:]], "4 rows of 4 finite numbers"),
        (lambda pose: [[float("nan"), 0, 0, 0], *pose[1:]], "4 rows of 4 finite numbers"),
        (lambda pose: [[1e300, 0, 0, 0], *pose[1:]], "a rotation and a translation"),
        (lambda pose: [*pose[:3], [0, 0, 0, 2]], "a rotation and a translation"),
        (lambda pose: [pose[1], pose[0], *pose[2:]], "a rotation and a translation"),  # mirrored
        (lambda pose: [[1, 0, 0, 1e9], *pose[1:]], "within 1e"),
    ],
)
def test_a_pose_that_is_none_is_named(change, message):
    with pytest.raises(ValueError, match=f"^pose must .*{message}"):
        recorded_pose(change(np.eye(4).tolist()))


def test_a_checked_pose_is_a_copy():
    pose = np.eye(4)
    checked = rigid_pose(pose)
    pose[0, 3] = 1.0
    assert checked[0, 3] == 0.0
