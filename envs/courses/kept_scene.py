"""Another course in a scene that has been driven through: a scene takes as long to make as some thirty steps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from envs.courses.course import CLEAR_RADIUS, EDGE, OFF_COURSE, Course, CourseConfig

BEARINGS = 72  # directions in which a goal is looked for around a place
PLACES = 20  # most places that are tried as a start


def another_course(course: Course, config: CourseConfig, rng: np.random.Generator) -> Course:
    """Draw another start and goal, free of obstacles within 2.5 m, and a heading at the start.

    The sun stays where it is, and so does a ditch: with config.into_sun the goal lies in the sun's direction, and with
    config.ditch the rover drives back between the same two places, whose surroundings may be less free. It does so too
    where the scene has no two others. With both settings, it drives the same course again, from another heading.

    Args:
        course: A course in the scene.
        config: The settings that it was drawn with.
        rng: Source of the random draws.
    """
    other = None if config.ditch else _elsewhere(course, config, rng)
    if other is None:
        start, goal = course.start[:2], course.goal
        other = course if config.into_sun else _between(course, goal, start)
    bearing = np.arctan2(*(other.goal - other.start[:2])[::-1])
    yaw = bearing + rng.uniform(-OFF_COURSE, OFF_COURSE)
    return replace(other, start=np.array([*other.start[:2], yaw]), redraws=0)


def _elsewhere(course: Course, config: CourseConfig, rng: np.random.Generator) -> Course | None:
    """Return a course between two places drawn from all that are clear; None if none was found."""
    places = course.ground.clear_places(CLEAR_RADIUS, EDGE + CLEAR_RADIUS)
    if len(places) == 0:
        return None
    for start in rng.choice(places, PLACES):
        bearings = rng.uniform(0, 2 * np.pi) + np.arange(BEARINGS) * (2 * np.pi / BEARINGS)
        if config.into_sun:
            bearings = np.array([np.arctan2(*course.scene.look.sun[1::-1])])
        goals = start + config.goal_distance * np.column_stack([np.cos(bearings), np.sin(bearings)])
        clear = [goal for goal in goals if _is_clear(course, goal)]
        if clear:
            other = _between(course, start, clear[rng.integers(len(clear))])
            if np.isfinite(other.shortest):
                return other
    return None


def _is_clear(course: Course, place: np.ndarray) -> bool:
    within = np.abs(place).max() <= course.scene.half - EDGE - CLEAR_RADIUS
    return bool(within and course.ground.clearance(*place) >= CLEAR_RADIUS)


def _between(course: Course, start: np.ndarray, goal: np.ndarray) -> Course:
    """Return the course from a start to a goal, both (2,) [m], in the same scene."""
    ground = course.ground.towards(goal)
    return Course(course.scene, ground, np.array([*start, 0.0]), goal, ground.distance_to_goal(*start), 0)
