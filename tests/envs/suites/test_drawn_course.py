"""Settings that leave no way are drawn again, and a seed of a course is that of its settings too."""

from dataclasses import dataclass

import numpy as np
import pytest

from envs.courses.course import REDRAWS, NoWayError
from envs.suites.drawn_course import MOST_DRAWS, draw_episode
from envs.suites.draws import EpisodeDraws
from envs.world.eyes import EyesConfig
from marssim.scene.presets import preset


@dataclass(frozen=True)
class AnyCourse:
    k: float
    redraws: int


def draw(monkeypatch, most_rocks, seed=0, options=None, **numbers):
    """Draw where only courses with few rocks have a way, after seven draws."""

    def course(scene, settings, spec, rng):
        if settings.k > most_rocks:
            raise NoWayError(f"k={settings.k} leaves no way")
        return AnyCourse(settings.k, 7)

    monkeypatch.setattr("envs.suites.drawn_course.draw_course", course)
    draws = EpisodeDraws(preset("utopia"), EyesConfig(), {"goal_distance": 9.0, **numbers}, None, None)
    return draw_episode(draws, options, np.random.default_rng(seed), np.random.default_rng(0))


def test_settings_that_leave_no_way_are_drawn_again_and_counted(monkeypatch):
    drawn = [draw(monkeypatch, 0.2, seed, k=(0.0, 0.4)) for seed in range(20)]
    assert all(course.k == settings.course.k <= 0.2 for settings, course in drawn)
    assert {course.redraws % REDRAWS for _, course in drawn} == {7}
    assert len({course.redraws for _, course in drawn}) > 2


def test_what_no_draw_mends_is_an_error(monkeypatch):
    with pytest.raises(NoWayError, match=r"k=0\.3 leaves no way"):
        draw(monkeypatch, 0.2, k=0.3)
    plain, drawn = EpisodeDraws.draw, []

    def counted(draws, rng):
        drawn.append(plain(draws, rng))
        return drawn[-1]

    monkeypatch.setattr(EpisodeDraws, "draw", counted)
    with pytest.raises(NoWayError):
        draw(monkeypatch, -1.0, k=(0.0, 0.4))
    assert len(drawn) == MOST_DRAWS
    with pytest.raises(NoWayError):  # the drawn sun does not matter, nor does a drawn k that an option replaces
        draw(monkeypatch, 0.2, k=0.3, sun_elevation_deg=(10, 20))
    with pytest.raises(NoWayError):
        draw(monkeypatch, 0.2, 0, {"k": 0.3}, k=(0.0, 0.4))
    assert len(drawn) == MOST_DRAWS + 2


def test_a_seed_of_the_course_is_that_of_its_settings_whatever_the_generator(monkeypatch):
    drawn = [
        draw(monkeypatch, 1.0, seed, {"scene_seed": of_course}, k=(0.0, 0.4))[1].k
        for seed, of_course in ((1, 5), (2, 5), (2, np.int64(5)), (1, 6), (1, 0), (2, 0))
    ]
    assert drawn[0] == drawn[1] == drawn[2] != drawn[3] and drawn[4] == drawn[5]
    assert draw(monkeypatch, 1.0, 1, k=(0.0, 0.4))[1].k != draw(monkeypatch, 1.0, 2, k=(0.0, 0.4))[1].k
    with pytest.raises(ValueError, match="scene_seed"):
        draw(monkeypatch, 1.0, 1, {"scene_seed": -1}, k=(0.0, 0.4))
