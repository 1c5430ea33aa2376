"""Steep ground on courses: ledges, ditches and craters, and the ways that go round them."""

from dataclasses import replace

import numpy as np
import pytest

from envs.courses.clearance import ObstacleClearance
from envs.courses.course import CLEAR_OF_STEEP_GROUND, CourseConfig, TrueGround, draw_course
from marssim.base.rover_spec import ZHURONG
from marssim.scene.ditches import SPACING, Ditch, Ditches
from marssim.scene.landforms import Craters

START, GOAL = np.array([-4.0, 0.0]), np.array([4.0, 0.0])


def ditch(y0, y1, width=1.6, depth=0.8, wall_deg=55.0):
    """A ditch along x = 0, between two y."""
    y = np.arange(y0, y1, SPACING)
    return Ditch(np.column_stack([0 * y, y]), np.full(len(y), width / 2), depth, np.tan(np.deg2rad(wall_deg)))


def dug(landform):
    """The relief of a landform on level ground, as a function of x and y."""

    def height(x, y):
        out = np.zeros(x.shape)
        landform.add_to(out, x[0], y[:, 0])
        return out

    return height


@pytest.mark.parametrize(("height", "blocks"), [(0.25, False), (0.35, True)])
def test_a_ledge_is_a_drop_by_its_height(make_scene, height, blocks):
    """Over a footprint, a ledge of 0.35 m is no steeper than 25 deg: it counts for its drop only."""
    scene = make_scene(lambda x, y: height * (x > 0), cell=0.1)
    ground = TrueGround(scene, ZHURONG, GOAL)
    assert np.isfinite(ground.distance_to_goal(*START)) != blocks
    assert (ground.clearance(0.0, 0.0) == 0) == blocks


def test_the_way_goes_round_a_ditch(make_scene):
    scene = make_scene(dug(Ditches((ditch(-9.9, 2.0),))), cell=0.08)
    ground = TrueGround(scene, ZHURONG, GOAL)
    # its end is round; the drop begins at its brink or a little before
    end = 2.0 + 0.8
    assert 2 * np.hypot(4.0, end + ZHURONG.width / 2 - 0.3) < ground.distance_to_goal(*START)
    way = ground.way_to_goal(*START)
    assert end + ZHURONG.width / 2 - 0.3 < way[:, 1].max() < end + ZHURONG.width / 2 + 0.6


def test_a_ditch_across_the_whole_ground_leaves_no_way(make_scene):
    ground = TrueGround(make_scene(dug(Ditches((ditch(-11, 11),))), cell=0.08), ZHURONG, GOAL)
    assert ground.distance_to_goal(*START) == np.inf
    assert np.isfinite(ground.distance_to_goal(2.0, -3.0))


@pytest.mark.parametrize(("freshness", "depth", "avoided"), [(1.0, 0.8, True), (0.3, 0.25, False)])
def test_the_way_avoids_a_fresh_crater_and_crosses_a_worn_one(make_scene, freshness, depth, avoided):
    crater = Craters(np.zeros((1, 2)), np.array([4.0]), np.array([freshness]), np.array([depth]))
    ground = TrueGround(make_scene(dug(crater), cell=0.08), ZHURONG, GOAL)
    assert (ground.distance_to_goal(*START) > 8.5) == avoided
    assert ground.steep.any() == avoided


def test_the_clearance_is_that_of_the_footprint_to_the_drop(make_scene):
    scene = make_scene(dug(Ditches((ditch(-11, 11),))), cell=0.08)
    ground = TrueGround(scene, ZHURONG, GOAL)
    clearance = ObstacleClearance(scene, ZHURONG, ground.steep)
    for x in (-2.4, -2.0, -1.8):
        place = np.array([x, 0.5, 0.0])
        beside_brink = -0.8 - (x + ZHURONG.length / 2)
        assert max(beside_brink - 0.4, 0) <= clearance.between(place, place) <= beside_brink + 0.1
    inside = np.array([0.0, 0.5, 0.0])
    assert clearance.between(inside, inside) == 0


@pytest.fixture(scope="module")
def ditched(small_scene):
    relief = replace(small_scene.relief, ditch_density=0.02, fresh_crater_density=0.01)
    return replace(small_scene, relief=relief)


def test_start_and_goal_of_drawn_courses_keep_clear_of_ditches(ditched):
    for seed in range(3):
        course = draw_course(ditched, CourseConfig(goal_distance=8.0, k=0.0), ZHURONG, np.random.default_rng(seed))
        assert course.ground.steep.any()
        for x, y in (course.start[:2], course.goal):
            assert course.ground.clearance(x, y) >= CLEAR_OF_STEEP_GROUND
            angle = np.linspace(0, 2 * np.pi, 40)
            ring = course.scene.terrain.height_at(x + 2.3 * np.cos(angle), y + 2.3 * np.sin(angle))
            assert np.abs(np.diff(ring)).max() < 0.3


def test_courses_that_start_on_steep_ground_are_drawn_again(small_scene, make_scene, monkeypatch):
    hill = make_scene(lambda x, y: np.where(np.abs(y) < 9, 0.8 * np.abs(x), 0.0), cell=0.1)
    scenes = iter([hill, make_scene()])
    monkeypatch.setattr("envs.courses.course.build_scene", lambda *_: next(scenes))
    course = draw_course(small_scene, CourseConfig(goal_distance=8.0), ZHURONG, np.random.default_rng(0))
    assert course.redraws == 1


def test_too_many_ditches_are_an_error_that_names_them(ditched, make_scene, monkeypatch):
    scene = make_scene(dug(Ditches((ditch(-11, 11), ditch(-11, 11, width=8.0)))), cell=0.08)
    monkeypatch.setattr("envs.courses.course.build_scene", lambda *_: scene)
    monkeypatch.setattr("envs.courses.course.REDRAWS", 2)
    with pytest.raises(ValueError, match=r"2 draws: .* with a ditch_density of 0\.02 leave no way"):
        draw_course(ditched, CourseConfig(goal_distance=8.0), ZHURONG, np.random.default_rng(0))


@pytest.mark.parametrize("dynamics", ["kinematic", "physics"])
def test_a_fall_into_a_deep_ditch_ends_the_drive(make_scene, make_course, on_course, dynamics):
    scene = make_scene(dug(Ditches((ditch(-11, 11, width=2.4, depth=1.1, wall_deg=60),))), cell=0.08)
    env = on_course(make_course(scene), dynamics=dynamics)
    for _ in range(20):
        *_, terminated, _, info = env.step(np.array([1.0, 0.0], np.float32))
        if terminated:
            break
    assert info["outcome"] in ("tilt", "collision") and info["min_clearance"] == 0
