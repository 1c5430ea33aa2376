import numpy as np
import pytest
from drawn_maps import flat_map_with_rocks
from hypothesis import given
from hypothesis import strategies as st

from marssim.base.rover_spec import ZHURONG
from nav.path.footprint import arc_poses, footprint_corners, footprint_discs, footprint_distance


@given(st.floats(-1.2, 1.2), st.floats(-3, 3), st.floats(-1, 4))
def test_arcs_are_what_driving_them_gives(curvature, yaw, distance):
    end = arc_poses(np.array([0.5, -0.5, yaw]), np.array(curvature), np.array([distance]))[0]
    heading = yaw + curvature * (np.arange(2000) + 0.5) / 2000 * distance
    x = 0.5 + np.cos(heading).mean() * distance
    y = -0.5 + np.sin(heading).mean() * distance
    np.testing.assert_allclose(end, [x, y, yaw + curvature * distance], atol=1e-5)


def test_discs_cover_the_footprint():
    centres, radius = footprint_discs(ZHURONG)
    x, y = np.meshgrid(np.linspace(-1, 1, 41) * ZHURONG.length / 2, np.linspace(-1, 1, 41) * ZHURONG.width / 2)
    assert (np.hypot(x[..., None] - centres[:, 0], y[..., None] - centres[:, 1]).min(-1) <= radius + 1e-9).all()
    assert np.abs(centres).max(0)[1] + radius < ZHURONG.width / 2 + 0.07
    assert np.abs(centres).max(0)[0] + radius < ZHURONG.length / 2 + 0.09


@pytest.mark.parametrize("yaw", [0.0, np.pi / 2, np.pi])
def test_the_distance_is_from_the_footprints_edge(yaw):
    """A wall whose face is at x = 3: the rover's front or side comes up to it, less what the discs cover beyond."""
    elevation, ground = flat_map_with_rocks([(3.5, y, 0.5) for y in np.arange(-6.0, 6.1, 1.0)])
    reach = abs(np.cos(yaw)) * ZHURONG.length / 2 + abs(np.sin(yaw)) * ZHURONG.width / 2
    poses = np.array([[x, 0.0, yaw] for x in (-1.0, 0.5)])
    distance = footprint_distance(ground.clearance, elevation, poses, ZHURONG)
    np.testing.assert_allclose(distance, 3.0 - poses[:, 0] - reach, atol=0.2)
    assert footprint_distance(ground.clearance, elevation, np.array([3.0, 0.0, yaw]), ZHURONG) < 0
    assert footprint_distance(ground.clearance, elevation, np.array([7.9, 0.0, yaw]), ZHURONG) == -np.inf


@given(st.tuples(st.floats(-50, 50), st.floats(-50, 50), st.floats(-7, 7)))
def test_corners_are_half_a_length_ahead_and_half_a_width_aside(pose):
    front_left, front_right, back_right, back_left = footprint_corners(ZHURONG, pose)
    ahead, left = np.array([np.cos(pose[2]), np.sin(pose[2])]), np.array([-np.sin(pose[2]), np.cos(pose[2])])
    np.testing.assert_allclose((front_left + front_right) / 2 - pose[:2], ahead * ZHURONG.length / 2, atol=1e-9)
    np.testing.assert_allclose((front_left + back_left) / 2 - pose[:2], left * ZHURONG.width / 2, atol=1e-9)
    np.testing.assert_allclose((front_left + back_right) / 2, pose[:2], atol=1e-9)
