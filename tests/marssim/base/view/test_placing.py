from dataclasses import replace

import numpy as np
import pytest

from marssim.base.camera import PinholeCamera, StereoRig
from marssim.base.pose import look_pose
from marssim.base.view.placing import moved_along, point_size, reach_of, stands, upright
from marssim.base.view.scene import View


def test_the_upright_frame_has_the_heading_of_the_camera_and_z_up():
    frame = upright(look_pose(np.array([1.0, 2, 3]), np.deg2rad(90), np.deg2rad(20), roll=0.1))
    assert np.allclose(frame[:3, :3], [[0, -1, 0], [1, 0, 0], [0, 0, 1]]) and np.allclose(frame[:3, 3], [1, 2, 3])


@pytest.mark.parametrize("pitch_deg", [90, -90])
def test_a_camera_that_looks_straight_down_or_up_has_a_heading_too(pitch_deg):
    frame = upright(look_pose(np.zeros(3), np.deg2rad(30), np.deg2rad(pitch_deg)))
    assert np.allclose(frame[:2, 0], [np.cos(np.pi / 6), 0.5], atol=1e-6)


def test_the_viewer_keeps_his_place_beside_a_camera_that_moves_and_turns():
    before = look_pose(np.array([0.0, 0, 1]), 0.0, 0.3)
    after = look_pose(np.array([5.0, 0, 2]), np.pi / 2, -0.2)
    behind, ahead = np.array([-2.0, 0, 2]), np.array([3.0, 0, 0])
    assert np.allclose(moved_along(np.stack([behind, ahead]), before, after), [[5, -2, 3], [5, 3, 1]])


def test_all_stands_look_at_the_ground_that_the_camera_looks_at():
    pose = look_pose(np.array([0.0, 0, 2]), 0.0, np.deg2rad(30))
    places = stands(pose, 4.0)
    for _, seen in places.values():
        assert np.allclose(seen, [4 * np.cos(np.pi / 6), 0, 0])
    behind, through, above = (position for position, _ in places.values())
    assert behind[0] < 0 and behind[2] > 2 and np.allclose(through, [0, 0, 2]) and above[2] > behind[2]


def test_points_nearly_touch_at_the_median_depth():
    rig = StereoRig(PinholeCamera.centred(100, 100, 200.0), 0.1)
    points = np.zeros((10_000, 3), np.float32)
    points[:, 2] = 4.0
    view = View(rig, None, points, {})
    assert reach_of(view) == 4.0 and point_size(view) == pytest.approx(0.02)
    assert point_size(replace(view, points=points[::4])) == pytest.approx(0.04)
    empty = replace(view, points=points[:0])
    assert 0 < point_size(empty) < 1 and reach_of(empty) == 3.0 and reach_of(replace(empty, reach=25.0)) == 25.0
