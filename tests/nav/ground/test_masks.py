"""Masks of map cells, against the distances of the cells' centres."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from nav.ground.elevation import ElevationConfig, ElevationMap
from nav.ground.masks import disc_mask, outside_mask, rectangle_mask

MAP = ElevationMap(ElevationConfig(size=12.0))
CELL = MAP.config.cell
X, Y = np.meshgrid(*MAP.centres())


@given(st.floats(-3, 3), st.floats(-3, 3), st.floats(-3.1, 3.1))
def test_a_rectangle_is_marked_to_within_a_cell(x, y, yaw):
    mask = rectangle_mask(MAP, np.array([x, y, yaw]), 0.8, 0.5)
    along = np.cos(yaw) * (X - x) + np.sin(yaw) * (Y - y)
    across = np.cos(yaw) * (Y - y) - np.sin(yaw) * (X - x)
    beyond = np.maximum(np.abs(along) - 0.8, np.abs(across) - 0.5)
    assert mask[beyond < -1.5 * CELL].all() and not mask[beyond > 1.5 * CELL].any()


def test_cells_near_any_of_several_positions_are_marked():
    centres = [np.array([1.0, 2.0]), np.array([-2.5, 0.3])]
    mask = disc_mask(MAP, centres, 1.0)
    distance = np.min([np.hypot(X - x, Y - y) for x, y in centres], axis=0)
    assert mask[distance < 1.0 - 1.5 * CELL].all() and not mask[distance > 1.0 + 1.5 * CELL].any()


def test_cells_farther_than_a_distance_outside_an_area_are_marked():
    mask = outside_mask(MAP, (-2.0, -3.0, 4.0, 1.0), 0.5)
    expected = (X < -2.5) | (X > 4.5) | (Y < -3.5) | (Y > 1.5)
    np.testing.assert_array_equal(mask, expected)
