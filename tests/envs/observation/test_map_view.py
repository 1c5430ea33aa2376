from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from envs.observation.map_view import CELL, PIXELS, MapView
from envs.world.perception import Sight
from marssim.base.camera import NATECAM
from marssim.base.rover_spec import ZHURONG
from marssim.physics.state import rotation

RIG = NATECAM.resized(64, 64)
NOTHING = Sight(np.full((64, 64), np.nan, np.float32), np.zeros((64, 64), np.float32), RIG, np.eye(4), 0.0)


def pose(x, y, yaw, z=0.0):
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rotation(0.0, 0.0, yaw), (x, y, z)
    return out


@pytest.fixture
def started():
    view = MapView(ZHURONG)
    view.start(pose(0.0, 0.0, 0.0))
    return view


def test_before_anything_was_seen_the_start_is_taken_for_flat(started):
    height, cost, known = started.update(NOTHING, pose(0.0, 0.0, 0.0))
    axis = (np.arange(PIXELS) + 0.5 - PIXELS / 2) * CELL
    away = np.hypot(*np.meshgrid(axis, axis))
    assert (known[away < 2.3] == 1).all() and (known[away > 2.7] == 0).all()
    assert (height == 0).all() and cost[away < 1].max() < cost[away > 4].min()


def test_the_corners_of_what_is_shown_lie_on_the_map(started):
    """Turned by 45 deg they are 9 m off in the four directions of the compass. Beyond the map all would be closed."""
    for x in (0.0, 2.9, 3.9, 6.0, 20.0):
        height, cost, known = started.update(NOTHING, pose(x, 0.0, np.pi / 4))
        for row, column in ((0, 0), (0, -1), (-1, 0), (-1, -1)):
            assert 0 < cost[row, column] < 1 and known[row, column] == 0 and height[row, column] == 0


def test_the_start_stays_behind_and_heights_are_from_where_it_stands(started):
    for x in (2.0, 4.0):
        height, _, known = started.update(NOTHING, pose(x, 0.0, 0.0, z=-0.5))
    behind = np.s_[PIXELS // 2 + round(3.5 / CELL), PIXELS // 2]  # 3.5 m back: where the flat start was
    far = started.update(NOTHING, pose(40.0, 0.0, 0.0))[2]
    assert far[PIXELS // 2, PIXELS // 2] == 1 and far.sum() < 100  # under the rover; the start was left behind
    assert known[behind] == 1 and height[behind] == pytest.approx(0.25)  # 0.5 m higher, in units of 2 m


def test_looks_of_another_rover_are_taken_in_from_the_height_of_its_camera(started, monkeypatch):
    heights = []
    monkeypatch.setattr(
        "nav.ground.elevation.ElevationMap.integrate", lambda self, *arguments: heights.append(arguments[-1])
    )
    low = MapView(replace(ZHURONG, mount=replace(ZHURONG.mount, height=0.6)))
    low.start(pose(0.0, 0.0, 0.0))
    for view in (started, low):
        view.update(NOTHING, pose(0.0, 0.0, 0.0))
    assert heights == [1.2, 0.6]


@pytest.mark.parametrize("side", [1, -1])
def test_a_turned_mast_shows_what_lies_aside(on_course, make_scene, make_course, side):
    env = on_course(make_course(make_scene()), mast=True)
    for _ in range(4):
        env.step(np.array([0.0, 0.0, side * 0.8]))
    view = MapView(ZHURONG)
    view.start(env.believed_pose)
    known = view.update(env.sight, env.believed_pose)[2]

    def seen(bearing):
        """Share of what is known 4 m away in a direction."""
        row, column = (round(PIXELS / 2 - 4 / CELL * part) for part in (np.cos(bearing), np.sin(bearing)))
        return known[row - 2 : row + 3, column - 2 : column + 3].mean()

    pan = side * 0.4 * np.pi
    assert env.sight.pan == pytest.approx(pan)
    assert seen(pan) > 0.5 and seen(0.0) == seen(-pan) == 0


@given(st.floats(-np.pi, np.pi), st.integers(-40, 40), st.integers(-40, 40), st.floats(0, 0.1))
def test_an_obstacle_of_one_cell_is_shown_however_the_rover_is_turned(yaw, aside, along, offset):
    view, place = MapView(ZHURONG), pose(offset, -offset, yaw)
    view.start(place)
    column, row = np.array([aside, along]) + view.map.cell_of(place[:2, 3])
    only = np.zeros((view.map.n, view.map.n))
    only[row, column] = 1.0
    shown = view._largest(only, place)
    x, y = view.map.centres()
    ahead, left = (np.array([x[column], y[row]]) - place[:2, 3]) @ place[:2, :2]
    at = np.floor(PIXELS / 2 - np.array([ahead, left]) / CELL).astype(int)
    assert shown.sum() == shown[tuple(at)] == 1
    assert (view._largest(only + 0.5, place) >= 0.5).all()  # every pixel holds the middle of a cell
