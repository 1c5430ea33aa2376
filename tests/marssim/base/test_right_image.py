"""The right image of a camera that is turned a little, compared with PinholeCamera.project."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from marssim.base.camera import PinholeCamera, StereoRig
from marssim.base.right_image import (
    IDEAL,
    image_disparity,
    is_rotation,
    outside_right,
    recorded_rotation,
    vertical_disparity,
)

RIG = StereoRig(PinholeCamera(31, 23, 40.0, 44.0, 14.2, 12.1), 0.27)
SMALL = st.floats(-0.02, 0.02)


def depth_map(seed: int = 0) -> np.ndarray:
    """Depths from 0.6 m to 60 m, and some sky."""
    rng = np.random.default_rng(seed)
    depth = np.exp(rng.uniform(np.log(0.6), np.log(60), (23, 31))).astype(np.float32)
    depth[rng.random(depth.shape) < 0.1] = np.inf
    return depth


def projected(depth: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """Return (H, W, 2) pixels of the right image; NaN in the sky."""
    points = RIG.camera.unproject(np.where(np.isfinite(depth), depth, np.nan)) - [RIG.baseline, 0, 0]
    return RIG.camera.project(points @ rotation)


@given(SMALL, SMALL, SMALL, st.integers(0, 9))
def test_disparity_is_that_of_the_projection(x, y, z, seed):
    depth, rotation = depth_map(seed), cv2.Rodrigues(np.array([x, y, z]))[0]
    expected = np.arange(31) - projected(depth, rotation)[..., 0]
    assert np.allclose(image_disparity(RIG, depth, rotation), np.where(np.isfinite(depth), expected, 0), atol=2e-4)


@given(SMALL, SMALL, SMALL, st.integers(0, 9))
def test_vertical_disparity_is_that_of_the_projection(x, y, z, seed):
    depth, rotation = depth_map(seed), cv2.Rodrigues(np.array([x, y, z]))[0]
    known = np.isfinite(depth)
    points, c = RIG.camera.unproject(np.where(known, depth, 1.0)).reshape(-1, 3), RIG.camera
    matrix = np.array([[c.fx, 0, c.cx], [0, c.fy, c.cy], [0, 0, 1]])
    moved = rotation.T @ [-RIG.baseline, 0, 0]
    rows = cv2.projectPoints(points, cv2.Rodrigues(rotation.T)[0], moved, matrix, None)[0][:, 0, 1].reshape(23, 31)
    lower = np.where(known, rows - np.arange(23)[:, None], 0)
    assert np.allclose(vertical_disparity(RIG, depth, rotation), lower, atol=2e-4)


@given(SMALL, SMALL, SMALL, st.integers(0, 9))
def test_a_point_is_outside_where_its_projection_is(x, y, z, seed):
    depth, rotation = depth_map(seed), cv2.Rodrigues(np.array([x, y, z]))[0]
    u, v = np.moveaxis(projected(depth, rotation), -1, 0)
    with np.errstate(invalid="ignore"):
        expected = (u < -0.5) | (u > 30.5) | (v < -0.5) | (v > 22.5)
    assert np.array_equal(outside_right(RIG, depth, rotation), expected)


def test_without_a_rotation_both_are_those_of_the_ideal_rig():
    depth = depth_map()
    disparity = RIG.depth_to_disparity(depth)
    assert np.array_equal(image_disparity(RIG, depth), disparity)
    assert np.array_equal(image_disparity(RIG, depth, np.eye(3)), disparity)
    assert np.array_equal(outside_right(RIG, depth, IDEAL), np.isfinite(depth) & (np.arange(31) - disparity < -0.5))
    almost = cv2.Rodrigues(np.array([0.0, 1e-12, 0.0]))[0]
    assert np.allclose(image_disparity(RIG, depth, almost), disparity, atol=1e-5)


def test_a_recorded_rotation_is_checked():
    turn = cv2.Rodrigues(np.array([0.01, -0.02, 0.03]))[0]
    assert np.array_equal(recorded_rotation(turn.tolist()), turn) and np.array_equal(recorded_rotation(None), np.eye(3))
    huge = [[10**400, 0, 0], [0, 1, 0], [0, 0, 1]]
    for wrong in (turn * 1.1, turn[:2], "turn", np.diag([1.0, 1.0, -1.0]), huge):
        with pytest.raises(ValueError, match=r"^right_rotation is not a 3 x 3 rotation$"):
            recorded_rotation(wrong)


def test_a_mirror_and_nan_are_no_rotations():
    assert is_rotation(np.eye(3))
    assert not is_rotation(np.diag([1.0, 1.0, -1.0])) and not is_rotation(np.full((3, 3), np.nan))


@pytest.mark.filterwarnings("error")
def test_huge_numbers_are_no_rotation_and_give_no_warning():
    assert not is_rotation(np.diag([1e300, 1.0, 1.0]))
