from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from envs.courses.course import CELL, EDGE, CourseConfig, TrueGround, draw_course
from marssim.base.rover_spec import ZHURONG

RADIUS = ZHURONG.width / 2


@pytest.fixture(scope="module")
def drawn(small_scene):
    rocky = replace(small_scene, rocks=replace(small_scene.rocks, k=0.15))
    return draw_course(rocky, CourseConfig(goal_distance=8.0), ZHURONG, np.random.default_rng(5))


def true_clearance(scene, x, y):
    """Distance to the nearest obstacle's disc, all of them looked at."""
    bodies = scene.bodies
    tall = bodies.height >= ZHURONG.obstacle_height
    gap = np.hypot(*(bodies.centre[tall, :2] - (x, y)).T) - bodies.diameter[tall] / 2
    return max(0.0, float(gap.min()))


def test_clearance_is_the_distance_to_the_nearest_disc(drawn):
    reach = drawn.scene.half - EDGE
    points = np.random.default_rng(1).uniform(-reach, reach, (400, 2))
    points = np.round((points + drawn.scene.half) / CELL) * CELL - drawn.scene.half  # where the grid has its values
    # rocks beyond the grid may be left out where they are farther than the rover's way to them, EDGE
    truth = np.array([min(true_clearance(drawn.scene, x, y), EDGE) for x, y in points])
    measured = np.array([min(drawn.ground.clearance(x, y), EDGE) for x, y in points])
    assert (truth == 0).sum() > 2 and (truth < RADIUS).sum() > 20
    np.testing.assert_allclose(measured, truth, atol=0.15)


def test_a_rock_beyond_the_edge_counts_where_it_reaches_in(make_scene):
    scene = make_scene(half=6.0, rocks=[(6.3, 0.0, 2.4, 0.5)])
    ground = TrueGround(scene, ZHURONG, np.zeros(2))
    assert ground.clearance(4.5, 0.0) == pytest.approx(0.6, abs=0.15)


def test_only_obstacles_count(make_scene):
    low, tall = (3.0, 0.0, 1.0, 0.29), (0.0, -4.0, 1.0, 0.31)
    ground = TrueGround(make_scene(rocks=[low, tall]), ZHURONG, np.zeros(2))
    assert ground.clearance(3.0, 0.0) == pytest.approx(np.hypot(3, 4) - 0.5, abs=0.15)
    assert ground.clearance(0.0, -4.0) == 0
    assert TrueGround(make_scene(rocks=[low]), ZHURONG, np.zeros(2)).clearance(0, 0) == 20  # the ground's side


@pytest.fixture(scope="module")
def empty(make_scene):
    goal = np.array([2.13, -1.27])
    return goal, TrueGround(make_scene(), ZHURONG, goal)


@settings(max_examples=100)
@given(point=st.tuples(st.floats(-8.4, 8.4), st.floats(-8.4, 8.4)))
def test_on_empty_ground_the_way_is_all_but_straight(empty, point):
    goal, ground = empty
    straight = float(np.hypot(*(goal - point)))
    assert straight - 1e-6 <= ground.distance_to_goal(*point) <= 1.03 * straight + 0.3


def wall(gap_from, half=8.0):
    """Rocks along x = 0 from y = -9.5 to gap_from, without a gap between them."""
    return [(0.0, y, 1.0, 0.6) for y in np.arange(gap_from - 0.5, -half - 1.5, -0.4)]


def test_the_way_round_a_wall(make_scene):
    scene = make_scene(rocks=wall(2.5))  # its last rock ends at (0, 2.5), middle at (0, 2)
    start, goal = np.array([-4.0, 0.0]), np.array([4.0, 0.0])
    # tangents to the circle about the last rock's middle on which the rover's middle may pass, and the arc between
    corner, radius = np.array([0.0, 2.0]), 0.5 + RADIUS
    apart = float(np.hypot(*(start - corner)))
    tangent = np.sqrt(apart**2 - radius**2)
    # the angle from start over the top to goal, less those of the two right triangles
    turn = 2 * (np.pi / 2 + np.arctan2(2.0, 4.0)) - 2 * np.arccos(radius / apart)
    expected = 2 * tangent + radius * turn
    measured = TrueGround(scene, ZHURONG, goal).distance_to_goal(*start)
    assert 0.98 * expected <= measured <= 1.04 * expected + 0.1


def test_the_way_is_as_long_as_distance_to_goal_and_passable_all_along(make_scene, drawn):
    walled = TrueGround(make_scene(rocks=wall(2.5)), ZHURONG, np.array([4.0, 0.0]))
    for ground, start, goal in ((walled, (-4.0, 0.0), (4.0, 0.0)), (drawn.ground, drawn.start[:2], drawn.goal)):
        way = ground.way_to_goal(*start)
        np.testing.assert_allclose(way[[0, -1]], [start, goal])
        sides = np.diff(way, axis=0)
        assert np.hypot(*sides.T).sum() == pytest.approx(ground.distance_to_goal(*start), abs=1e-6)
        along = (way[:-1, None] + np.linspace(0, 1, 50)[:, None] * sides[:, None]).reshape(-1, 2)
        assert min(ground.clearance(x, y) for x, y in along) > RADIUS - 2 * CELL
    corners = walled.way_to_goal(-4.0, 0.0)
    assert corners[:, 1].max() > 2.5 + RADIUS and 3 <= len(corners) < 20  # round the wall, without points on its sides


def test_no_way_has_no_corners(make_scene):
    closed = TrueGround(make_scene(rocks=wall(9.5)), ZHURONG, np.array([4.0, 0.0]))
    assert closed.way_to_goal(-4.0, 0.0).shape == (0, 2)


def test_no_way_is_infinite(make_scene):
    ground = TrueGround(make_scene(rocks=wall(9.5)), ZHURONG, np.array([4.0, 0.0]))
    assert ground.distance_to_goal(-4.0, 0.0) == np.inf
    assert np.isfinite(ground.distance_to_goal(2.0, -3.0))


def test_a_goal_within_a_rock_has_no_way_from_anywhere(make_scene):
    """From beside it neither, where the nearest cells are those of the rock about the goal."""
    ground = TrueGround(make_scene(rocks=[(2.0, 0.0, 1.6, 0.6)]), ZHURONG, np.array([2.0, 0.0]))
    for x in (-4.0, 0.3, 1.2, 2.0):
        assert ground.distance_to_goal(x, 0.0) == np.inf


def test_near_the_goal_the_way_is_exact_though_it_lies_between_the_cells(empty):
    """At the cells' middles, every 0.2 m: from elsewhere the way to one of them is added."""
    goal, ground = empty
    east, north = np.meshgrid(*[np.arange(-8, 9) * 0.2] * 2)
    for place in np.stack([2.2 + east.ravel(), -1.2 + north.ravel()], axis=1):
        straight = float(np.hypot(*(goal - place)))
        assert straight - 1e-6 <= ground.distance_to_goal(*place) <= 1.03 * straight + 0.05


def test_a_way_along_the_edge_is_none(make_scene):
    """The wall ends at 8.2 m: the rover's middle would pass it at 8.9 m, but has to keep EDGE from 10 m."""
    for end, open_ in ((8.2, False), (7.6, True)):
        ground = TrueGround(make_scene(rocks=wall(end)), ZHURONG, np.array([4.0, 0.0]))
        assert np.isfinite(ground.distance_to_goal(-4.0, 0.0)) == open_


def test_a_rover_that_brushes_a_rock_still_has_a_way(make_scene):
    ground = TrueGround(make_scene(rocks=[(-4.0, 0.9, 1.0, 0.6)]), ZHURONG, np.array([4.0, 0.0]))
    assert ground.clearance(-4.0, 0.0) < RADIUS
    assert ground.distance_to_goal(-4.0, 0.0) == pytest.approx(0.3 + 8.0, abs=0.3)  # out of its way, then across


@pytest.mark.parametrize("place", [(9.0, 0.0), (0.0, 9.9), (-9.9, -9.9), (11.0, 0.0)])
def test_a_rover_that_left_the_ground_still_has_a_way(empty, place):
    goal, ground = empty
    assert ground.distance_to_goal(*place) == pytest.approx(np.hypot(*(goal - place)), rel=0.06)


def test_start_and_goal_are_clear_and_apart(drawn):
    start, goal = drawn.start[:2], drawn.goal
    assert np.hypot(*(goal - start)) == pytest.approx(8.0)
    big = drawn.scene.rocks.diameter >= 0.1
    assert big.sum() > 100
    for place in (start, goal):
        gap = np.hypot(*(drawn.scene.rocks.centre[big, :2] - place).T)
        assert gap.min() > 2.5
    bearing = np.arctan2(*(goal - start)[::-1])
    assert 0.05 < abs((drawn.start[2] - bearing + np.pi) % (2 * np.pi) - np.pi) <= np.pi / 4
    assert 8.0 <= drawn.shortest == drawn.ground.distance_to_goal(*start)


def test_courses_without_a_way_are_drawn_again(small_scene, make_scene, monkeypatch):
    scenes = iter([make_scene(rocks=ring()), make_scene(rocks=ring()), make_scene()])
    monkeypatch.setattr("envs.courses.course.build_scene", lambda *_: next(scenes))
    course = draw_course(small_scene, CourseConfig(goal_distance=8.0), ZHURONG, np.random.default_rng(0))
    assert course.redraws == 2 and np.isfinite(course.shortest)


def ring():
    """Rocks all round the middle, inside of any start that lies 3 m or more from it, and outside of its goal's 1 m."""
    return [(x, y, 0.8, 0.6) for x in np.arange(-8, 8.1, 1.0) for y in np.arange(-8, 8.1, 1.0)]


def test_no_way_in_any_draw_is_an_error_that_names_k(small_scene, make_scene, monkeypatch):
    scene = make_scene(rocks=ring())
    monkeypatch.setattr("envs.courses.course.build_scene", lambda *_: scene)
    monkeypatch.setattr("envs.courses.course.REDRAWS", 3)
    with pytest.raises(ValueError, match=r"3 draws: k=0\.3 "):
        draw_course(small_scene, CourseConfig(goal_distance=8.0, k=0.3), ZHURONG, np.random.default_rng(0))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("goal_distance", 2.9), ("goal_distance", 101), ("goal_distance", "far"), ("goal_distance", None),
        ("goal_distance", float("nan")), ("k", -0.1), ("k", 0.5), ("k", [0.1]), ("k", True), ("k", float("nan")),
        ("slope_deg", -1), ("slope_deg", 26), ("slope_deg", "steep"), ("sun_elevation_deg", 0),
        ("sun_elevation_deg", 91), ("sun_elevation_deg", (10, 20)), ("scene_seed", -1), ("scene_seed", 1.5),
    ],
)  # fmt: skip
def test_bad_settings_are_named(name, value):
    with pytest.raises(ValueError, match=rf"^{name} must .*got") as error:
        CourseConfig(**{name: value})
    assert "\n" not in str(error.value)


def test_numbers_of_numpy_are_numbers():
    config = CourseConfig(goal_distance=np.float32(5), k=np.float64(0.1), scene_seed=np.int64(3))
    assert (config.goal_distance, config.scene_seed) == (5, 3)
