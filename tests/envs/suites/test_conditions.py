from dataclasses import replace

import numpy as np
import pytest

from envs.courses.course import CourseConfig
from envs.suites.conditions import CONDITIONS, condition_values, under
from envs.world.eyes import EyesConfig
from marssim.scene.presets import preset

PLAIN = preset("utopia"), CourseConfig(), EyesConfig()


@pytest.mark.parametrize("name", CONDITIONS)
def test_each_condition_but_clear_changes_something(name):
    assert (under(name, *PLAIN) == PLAIN) == (name == "clear")


def test_the_values_reach_place_course_and_eyes():
    scene, course, eyes = under({"scene": "gale", "optical_depth": 3.0, "k": 0.2, "look_every": 4.0}, *PLAIN)
    assert scene == replace(preset("gale"), look=replace(preset("gale").look, optical_depth=(3.0, 3.0)))
    assert course == CourseConfig(k=0.2) and eyes == EyesConfig(look_every=4.0)


@pytest.mark.parametrize(
    ("condition", "message"),
    [
        ("strom", r"^condition 'strom' is unknown \(did you mean storm\?\); choose from clear"),
        ({"dust": 1}, "^condition: value 'dust' is unknown; choose from albedo_contrast"),
        ({"k": 2}, r"^k must lie in \[0, 0.4\]"), ({"optical_depth": 20.0}, "^optical_depth must be"),
        ({"lens_dust": 2}, "^lens_dust must lie"), (3, "^condition must be a name or a dict of values, got 3"),
        ({"ditch": True, "goal_distance": 5.0}, "^ditch needs a `goal_distance` of 12 m or more, got 5"),
        ({"into_sun": 1}, "^into_sun must be True or False"),
        ({"scene": 3}, "^scene must be a preset or the JSON file of a place, got 3"),
        ({"pebbles": "x"}, "^pebbles must be a number, got 'x'"),
        ({"drifts": True}, "^drifts must be a number, got True"),
    ],
)  # fmt: skip
def test_bad_conditions_are_refused_by_name(condition, message):
    with pytest.raises(ValueError, match=message):
        under(condition, *PLAIN)


def test_values_are_returned_as_they_are():
    assert condition_values({"k": 0.1}) == {"k": 0.1} and condition_values("storm") == {"optical_depth": 3.0}


def test_an_environment_takes_a_condition_by_its_name(make_env):
    env = make_env(condition="into_sun")
    env.reset(seed=4)
    towards = env.course.goal - env.course.start[:2]
    sun = env.course.scene.look.sun
    assert np.dot(towards, sun[:2]) / np.hypot(*towards) / np.hypot(*sun[:2]) == pytest.approx(1, abs=1e-6)
    assert np.rad2deg(env.course.scene.look.sun_elevation) == pytest.approx(12)
    plain = make_env()
    plain.reset(seed=4)
    np.testing.assert_array_equal(env.course.scene.terrain.fine.heights, plain.course.scene.terrain.fine.heights)


def test_a_ditch_makes_the_way_longer(make_env):
    env = make_env(goal_distance=12.0, condition={"ditch": True})
    _, info = env.reset(seed=4)
    _, plain = env.reset(seed=4, options={"ditch": False})
    assert info["shortest"] > plain["shortest"] + 0.3
