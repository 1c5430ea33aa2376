from dataclasses import replace

import numpy as np
import pytest
from drawn_maps import flat_map_with_rocks, map_of_height
from hypothesis import given
from hypothesis import strategies as st

from marssim.base.rover_spec import ZHURONG
from nav.path.stance import StanceModel


@given(st.floats(0, 20), st.floats(-3.1, 3.1), st.floats(-3.1, 3.1))
def test_on_a_plane_the_tilt_is_the_planes(slope_deg, towards, yaw):
    rise = np.tan(np.deg2rad(slope_deg))
    elevation = map_of_height(lambda x, y: rise * (np.cos(towards) * x + np.sin(towards) * y))
    place = StanceModel(elevation, ZHURONG).at(np.array([0.3, -0.2, yaw]))
    assert np.rad2deg(place.tilt) == pytest.approx(slope_deg, abs=3)  # cells of 0.1 m round the wheels' heights
    # the highest cell within 0.15 m, under wheels and belly alike
    assert place.clearance == pytest.approx(ZHURONG.belly_clearance, abs=0.06)


@pytest.mark.parametrize("yaw", [0.0, np.pi / 2])
def test_across_and_along_a_slope_the_tilt_is_exact(yaw):
    """Wheels that are whole cells apart in both directions rest on cells that are as far apart."""
    slope = map_of_height(lambda x, y: np.tan(np.deg2rad(15)) * y)
    spec = replace(ZHURONG, wheel_x=(0.6, 0.0, -0.6))
    place = StanceModel(slope, spec).at(np.array([0.05, 0.05, yaw]))
    assert np.rad2deg(place.tilt) == pytest.approx(15, abs=0.01)


@pytest.mark.parametrize("slope_deg", [-20, 20])
def test_the_belly_has_as_much_room_up_and_down_a_slope_wherever_the_middle_axle_is(slope_deg):
    slope = map_of_height(lambda x, y: np.tan(np.deg2rad(slope_deg)) * x)
    symmetric, ahead = (replace(ZHURONG, wheel_x=(0.6, middle, -0.6)) for middle in (0.0, 0.3))
    rooms = [StanceModel(slope, spec).at(np.array([0.05, 0.05, 0.0])).clearance for spec in (symmetric, ahead)]
    assert rooms[1] == pytest.approx(rooms[0], abs=1e-4)


def test_a_wheel_on_a_stone_tilts_and_a_stone_under_the_belly_takes_room():
    stone = map_of_height(lambda x, y: 0.25 * (np.hypot(x - 0.65, y - 0.6) < 0.15))
    place = StanceModel(stone, ZHURONG).at(np.zeros(3))
    # on one of three left wheels, and the front of one of two sides
    expected = np.hypot(0.25 / 3 / ZHURONG.track, 0.25 / (0.65 + 0.325) / 2)
    assert place.tilt == pytest.approx(np.arctan(expected), abs=0.01)
    between = map_of_height(lambda x, y: 0.25 * (np.hypot(x - 0.3, y) < 0.15))
    place = StanceModel(between, ZHURONG).at(np.zeros(3))
    assert place.tilt == pytest.approx(0, abs=1e-6)
    assert place.clearance == pytest.approx(ZHURONG.belly_clearance - 0.25, abs=1e-6)


def test_the_stance_is_unknown_with_a_wheel_on_unseen_ground():
    elevation, _ = flat_map_with_rocks(seen=lambda x, y: x < 0.4)
    place = StanceModel(elevation, ZHURONG).at(np.array([[0.0, 0.0, 0.0], [-3.0, 0.0, 0.0], [50.0, 0.0, 0.0]]))
    np.testing.assert_array_equal(place.tilt, 0)
    assert np.isinf(place.clearance[[0, 2]]).all() and np.isfinite(place.clearance[1])


def test_the_stance_is_unknown_with_a_wheel_beyond_the_map():
    level = map_of_height(lambda x, y: 0 * x)  # to x = 8 m
    place = StanceModel(level, ZHURONG).at(np.array([[7.6, 0.0, 0.0], [0.0, 0.0, 0.0]]))
    assert np.isinf(place.clearance[0]) and np.isfinite(place.clearance[1])
