"""The course of an episode, with the settings that are drawn for it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from envs.courses.course import REDRAWS, Course, NoWayError, draw_course
from envs.suites.draws import EpisodeDraws, EpisodeSettings, stream_of_draws
from marssim.base.rover_spec import ZHURONG, RoverSpec

MOST_DRAWS = 5  # of the settings, after which an error says that they leave no way
HARD = {"k", "slope_deg", "goal_distance", "condition"}  # settings that may leave no way


def draw_episode(
    draws: EpisodeDraws, options: Any, rng_of_draws: np.random.Generator, rng: np.random.Generator,
    spec: RoverSpec = ZHURONG,
) -> tuple[EpisodeSettings, Course]:  # fmt: skip
    """Draw the settings of an episode, and a course with them.

    Where something was drawn and no way leads to a goal, as with many rocks on a steep slope, the settings are drawn
    again. With the option scene_seed, the settings are those of this seed, whatever the generators.

    Args:
        draws: What is drawn.
        options: As MarsNavEnv.reset takes them; they replace what is drawn.
        rng_of_draws: Generator of the settings.
        rng: Generator of the course.
        spec: The rover.

    Raises:
        ValueError: As EpisodeSettings.with_options.
        NoWayError: As draw_course.
    """
    seed = options.get("scene_seed") if isinstance(options, Mapping) else None
    if isinstance(seed, int | np.integer) and seed >= 0:
        rng_of_draws = stream_of_draws(int(seed))
    redraws = 0
    while True:
        settings = draws.draw(rng_of_draws).with_options(options or {})
        try:
            course = draw_course(settings.scene, settings.course, spec, rng)
            return settings, replace(course, redraws=redraws + course.redraws)
        except NoWayError:
            redraws += REDRAWS
            if redraws == MOST_DRAWS * REDRAWS or not HARD & (set(settings.drawn) - set(options or {})):
                raise
