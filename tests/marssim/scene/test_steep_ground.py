import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from marssim.base.rover_spec import ZHURONG
from marssim.scene.steep_ground import steep_ground
from marssim.scene.terrain import HeightGrid, Terrain

AXIS = np.arange(-4, 4.01, 0.1)


def marked(heights):
    """The steep ground of heights over AXIS x AXIS."""
    grid = HeightGrid(heights, -4.0, -4.0, 0.1)
    return steep_ground(Terrain(grid, grid), ZHURONG, 4.0, 0.1)


@settings(max_examples=25)
@given(st.floats(0, 40), st.floats(0, 2 * np.pi))
def test_a_plane_is_steep_from_the_rovers_limit_on(degrees, azimuth):
    rise = np.tan(np.deg2rad(degrees))
    x, y = np.meshgrid(AXIS, AXIS)
    steep = marked(rise * (np.cos(azimuth) * x + np.sin(azimuth) * y))
    limit = np.rad2deg(ZHURONG.max_slope)
    if abs(degrees - limit) > 0.1:
        assert steep.all() == steep.any() == (degrees > limit)


@pytest.mark.parametrize(("height", "marks"), [(0.25, False), (0.35, True)])
def test_a_ledge_is_marked_within_a_wheels_width_by_its_height(height, marks):
    steep = marked(np.broadcast_to(height * (AXIS > 0.05), (81, 81)).copy())
    assert steep.any() == marks
    assert np.abs(AXIS[np.nonzero(steep)[1]]).max(initial=0) <= 0.3
