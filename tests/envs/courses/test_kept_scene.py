from dataclasses import replace

import numpy as np
import pytest

from envs.courses.course import CourseConfig
from envs.courses.kept_scene import another_course

ROCK = (1.0, -2.0, 1.2, 0.6)


def courses(course, number=12, seed=0, **config):
    """Several courses in a row in the same scene."""
    rng = np.random.default_rng(seed)
    config = CourseConfig(**{"goal_distance": 5.0, **config})
    made = []
    for _ in range(number):
        course = another_course(course, config, rng)
        made.append(course)
    return made


@pytest.fixture(scope="module")
def rocky(make_scene, make_course):
    return make_course(make_scene(rocks=[ROCK]), start=(-5.0, 2.0, 0.0), goal=(0.0, 2.0))


def test_each_course_has_a_clear_start_and_goal_of_its_own(rocky):
    made = courses(rocky)
    assert len({tuple(course.start) for course in made}) == len({tuple(course.goal) for course in made}) == 12
    for course in made:
        start, goal = course.start[:2], course.goal
        assert course.scene is rocky.scene and course.redraws == 0 and np.hypot(*(goal - start)) == pytest.approx(5.0)
        for place in (start, goal):
            assert np.hypot(*(place - ROCK[:2])) - 0.6 > 2.4 and np.abs(place).max() <= 6.0 + 1e-9
        off = course.start[2] - np.arctan2(*(goal - start)[::-1])
        assert abs(np.arctan2(np.sin(off), np.cos(off))) <= np.pi / 4
        assert 5.0 <= course.shortest == course.ground.distance_to_goal(*start) < 6.5
        assert course.ground.distance_to_goal(*goal) < 0.3  # the ways lead to this goal
    assert rocky.ground.distance_to_goal(0.0, 2.0) < 0.2  # and those of the first course still to its own


def test_courses_follow_from_the_stream(rocky):
    first, again, other = (courses(rocky, 3, seed)[-1] for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.start, again.start)
    assert not np.array_equal(first.start, other.start)


def test_the_goal_stays_under_the_sun(rocky):
    azimuth = np.arctan2(*rocky.scene.look.sun[1::-1])
    for course in courses(rocky, 5, into_sun=True):
        assert np.arctan2(*(course.goal - course.start[:2])[::-1]) == pytest.approx(azimuth)


@pytest.mark.parametrize("config", [{"ditch": True, "goal_distance": 12.0}, {"goal_distance": 40.0}])
def test_the_rover_drives_back_where_a_ditch_lies_or_no_other_places_are(rocky, config):
    back, forth = courses(rocky, 2, **config)
    np.testing.assert_array_equal(back.start[:2], rocky.goal)
    np.testing.assert_array_equal(back.goal, rocky.start[:2])
    np.testing.assert_array_equal(forth.goal, rocky.goal)
    assert back.shortest == pytest.approx(rocky.shortest, rel=0.05)


def test_under_the_sun_and_with_a_ditch_the_same_course_is_driven_from_another_heading(rocky):
    (again,) = courses(replace(rocky, redraws=3), 1, ditch=True, into_sun=True, goal_distance=12.0)
    np.testing.assert_array_equal(again.start[:2], rocky.start[:2])
    np.testing.assert_array_equal(again.goal, rocky.goal)
    assert again.start[2] != rocky.start[2] and again.redraws == 0  # nothing was drawn again


def test_without_a_clear_place_it_drives_back(make_scene, make_course):
    rocks = [(x, y, 0.6, 0.4) for x in np.arange(-7.5, 8, 3.0) for y in np.arange(-7.5, 8, 3.0)]
    course = make_course(make_scene(rocks=rocks), start=(-3.0, 3.0, 0.0), goal=(0.0, 3.0))
    assert len(course.ground.clear_places(2.5, 4.0)) == 0 < len(course.ground.clear_places(1.0, 4.0))
    (back,) = courses(course, 1, goal_distance=4.0)
    np.testing.assert_array_equal(back.start[:2], course.goal)
