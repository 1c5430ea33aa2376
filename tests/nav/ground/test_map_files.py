"""Layers and pictures of maps: which numbers they hold, and what lies where in the picture."""

import io
from dataclasses import replace

import numpy as np
import pytest
from drawn_maps import flat_map_with_rocks, map_of_height
from PIL import Image

from marssim.base.pose import look_pose
from marssim.base.rover_spec import ZHURONG
from nav import TraversabilityConfig, assess
from nav.ground.map_files import (
    BLOCKED,
    BORDER,
    COSTLY,
    FREE,
    LEFT,
    NEAR,
    UNKNOWN,
    MapWindow,
    class_colours,
    layers,
    map_page,
    map_picture,
    window_of,
    write_map,
)

GREY = (128, 128, 128)


def seen(x, y):
    return np.hypot(x, y) < 6


def judged(height):
    elevation = map_of_height(height)
    return elevation, assess(elevation, ZHURONG, TraversabilityConfig())


def page_of(window: MapWindow, cameras=(), axes=()) -> np.ndarray:
    """Return the page of a green picture."""
    picture = np.full((*window.shape, 3), (90, 170, 90), np.uint8)
    return map_page(picture, np.reshape(cameras, (-1, 2)), np.reshape(axes, (-1, 2)), window)


def window_at(west: float, south: float, rows: int, columns: int, cell: float) -> MapWindow:
    return MapWindow(slice(0, rows), slice(0, columns), west, south, cell)


def test_layers_hold_what_they_are_called():
    elevation, ground = flat_map_with_rocks([(3.0, 1.0, 0.4)], seen)
    made, known = layers(elevation, ground), elevation.measured
    for name, values in (
        ("elevation", elevation.low), ("top", elevation.top), ("weight", elevation.weight), ("step", ground.step),
        ("roughness", ground.roughness), ("cost", ground.cost),
    ):  # fmt: skip
        np.testing.assert_array_equal(made[name], np.where(known, values, np.nan), err_msg=name)
        assert made[name].dtype == np.float32
    assert not np.array_equal(ground.step[known], ground.roughness[known])
    assert {FREE, NEAR, BLOCKED, UNKNOWN} == set(np.unique(made["traversability"]))
    assert ((made["traversability"] == UNKNOWN) == ~known).all()


def test_the_slope_is_in_degrees():
    elevation, ground = judged(lambda x, y: np.tan(np.deg2rad(12)) * (0.6 * x + 0.8 * y))
    assert layers(elevation, ground)["slope_deg"][40:-40, 40:-40] == pytest.approx(12, abs=0.05)


def test_an_obstacle_that_was_not_measured_is_no_unknown_ground():
    elevation, ground = flat_map_with_rocks(seen=seen)
    blocked = ground.blocked.copy()
    blocked[3, 5] = True
    ground = replace(ground, blocked=blocked)
    assert not elevation.measured[3, 5] and layers(elevation, ground)["traversability"][3, 5] == BLOCKED
    window = window_of(elevation, ground, np.zeros((1, 2)))
    assert (window.rows.start, window.columns.start) == (3, 5)


def test_ground_is_green_where_it_is_cheap_and_yellow_where_it_is_costly():
    elevation, ground = judged(lambda x, y: 0 * x)
    for cost, colour in ((0.0, (90, 170, 90)), (COSTLY, (225, 205, 80)), (3 * COSTLY, (225, 205, 80))):
        colours = class_colours(elevation, replace(ground, cost=np.full_like(ground.cost, cost)))
        np.testing.assert_array_equal(colours[50, 60], colour)


def test_slopes_to_the_north_west_are_bright_and_those_to_the_south_east_dark():
    """The normal of a surface that falls to the north-west leans there. Slopes across the light are as level ground."""
    rises = {"north-west": (0.1, -0.1), "south-east": (-0.1, 0.1), "north-east": (-0.1, -0.1), "level": (0.0, 0.0)}
    shown = {}
    for name, (east, north) in rises.items():
        elevation, ground = judged(lambda x, y, east=east, north=north: east * x + north * y)
        ground = replace(ground, cost=np.zeros_like(ground.cost), inflated=0 * ground.inflated)
        shown[name] = float(map_picture(elevation, ground)[80, 80, 1])
    assert shown["north-west"] > 1.1 * shown["level"] and shown["south-east"] < 0.9 * shown["level"]
    assert shown["north-east"] == pytest.approx(shown["level"], rel=0.02)


def test_the_picture_has_the_north_above_and_cameras_look_along_their_axes(tmp_path):
    elevation, ground = flat_map_with_rocks([(3.0, 4.0, 0.5)], seen)
    pose = look_pose(np.array([-2.0, -3.0, 1.2]), np.pi / 2, np.deg2rad(20))  # looks north
    window = window_of(elevation, ground, pose[None, :2, 3])
    write_map(tmp_path, elevation, ground, window, pose[None])
    page = np.asarray(Image.open(io.BytesIO((tmp_path / "map.png").read_bytes()))).astype(int)
    factor = -(-600 // max(window.shape))
    height, width = (factor * side for side in window.shape)
    picture = page[BORDER : BORDER + height, LEFT + BORDER : LEFT + BORDER + width]
    red = (picture[..., 0] > 1.8 * picture[..., 1]) & (picture[..., 0] > 1.8 * picture[..., 2])

    def place(mask: np.ndarray) -> np.ndarray:
        """Return the middle of a mask in the map [m]."""
        row, column = np.argwhere(mask).mean(axis=0) + 0.5
        return np.array([window.west + column / factor * 0.1, window.south + (height - row) / factor * 0.1])

    assert place(red) == pytest.approx([3.0, 4.0], abs=0.15)
    white = (picture > 240).all(axis=-1)
    assert place(white) == pytest.approx([-2.0, -2.8], abs=0.25)  # the arrow reaches 30 px to the north


@pytest.mark.parametrize("axis", [(0.3, 0.0), (-1.0, 0.0), (0.0, 0.2), (0.0, -1.0)])
def test_a_camera_is_drawn_in_its_cell_with_an_arrow_of_30_px(axis):
    window = window_at(0.0, 0.0, 50, 100, 0.1)  # 6 px a cell
    white = (page_of(window, (40, 15), axis)[: 300 + 2 * BORDER, LEFT:] > 240).all(axis=-1)
    rows, columns = np.nonzero(white)
    at = np.array([BORDER + 6 * 40 + 3, BORDER + 6 * (49 - 15) + 3])  # column, row
    middle = np.array([(columns.min() + columns.max()) / 2, (rows.min() + rows.max()) / 2])
    assert middle - at == pytest.approx(14 * np.array([1, -1]) * np.sign(axis), abs=3)


def test_the_bar_is_as_long_as_it_says_and_ticks_stand_at_their_coordinates():
    window = window_at(-3.25, 7.5, 60, 100, 0.1)  # 6 px a cell, 10 m wide: the bar is 5 m long, and ticks 2 m apart
    page = page_of(window)
    below = 360 + 2 * BORDER
    assert (page[below + 46, :, 0] == 0).sum() == pytest.approx(5 * 60, abs=2)
    columns = np.flatnonzero((page[below - 3] == 0).all(axis=-1)) - LEFT - BORDER
    assert columns == pytest.approx([(x + 3.25) * 60 for x in (-2, 0, 2, 4, 6)], abs=1)
    rows = below - BORDER - np.flatnonzero((page[:below, LEFT + 3] == 0).all(axis=-1))
    assert sorted(rows) == pytest.approx([(y - 7.5) * 60 for y in (8, 10, 12)], abs=1)
