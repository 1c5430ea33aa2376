"""The conditions of a drive by name. Each has a physical cause, so that a drive which fails names it.

A condition is a dict of values: `scene`, a field of CourseConfig, of EyesConfig, or of a scene's LookConfig. They
replace those of MarsNavEnv's other arguments.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from numbers import Real
from pathlib import Path
from typing import Any

from envs.courses.course import CourseConfig
from envs.world.eyes import EyesConfig
from marssim.base.command.spelling import did_you_mean
from marssim.scene.look import LOOK_LIMITS, LookConfig
from marssim.scene.place_file import load_place
from marssim.scene.scene import SceneConfig

Values = Mapping[str, Any]

CONDITIONS: dict[str, Values] = {
    "clear": {},
    "smooth_dust": {"texture_strength": 0.1, "albedo_contrast": 0.1, "pebbles": 0.0, "wind_ripples": 0.0},
    "low_sun": {"sun_elevation_deg": 8.0},
    "into_sun": {"into_sun": True, "sun_elevation_deg": 12.0, "lens_glare": 0.3},
    "storm": {"optical_depth": 3.0},
    "dusty_lens": {"lens_dust": 0.4},
    "warm_rig": {"temperature": 50.0},
    "compressed": {"jpeg_quality": 25.0},
    "half_pixels": {"image_pixels": 256},
    "dense_rocks": {"k": 0.20, "slope_deg": 10.0},
    "ledges": {"scene": "gale"},
    "ditch": {"ditch": True},
    "far_goal": {"goal_distance": 80.0, "k": 0.07},  # a scene of 94 m cannot hold the small rocks of a larger k
    "rare_looks": {"look_every": 4.0},
}
OF_COURSE = tuple(field.name for field in fields(CourseConfig) if field.name != "sun_elevation_deg")
OF_EYES = tuple(field.name for field in fields(EyesConfig))


def condition_values(condition: str | Values) -> Values:
    """Return the values of a condition.

    Args:
        condition: A name of CONDITIONS, or values, which are checked and returned.

    Raises:
        ValueError: There is no condition or no value of that name.
    """
    if not isinstance(condition, str | Mapping):
        raise ValueError(f"condition must be a name or a dict of values, got {condition!r}")
    if not isinstance(condition, str):
        choices = {"scene", *OF_COURSE, *OF_EYES, *LOOK_LIMITS}
        if unknown := sorted(map(str, condition.keys() - choices)):
            raise ValueError(f"condition: value {unknown[0]!r} is unknown; choose from {', '.join(sorted(choices))}")
        return condition
    if condition not in CONDITIONS:
        names = ", ".join(CONDITIONS)
        raise ValueError(
            f"condition {condition!r} is unknown{did_you_mean(condition, list(CONDITIONS))}; choose from {names}"
        )
    return CONDITIONS[condition]


def under(
    condition: str | Values, scene: SceneConfig, course: CourseConfig, eyes: EyesConfig
) -> tuple[SceneConfig, CourseConfig, EyesConfig]:
    """Return place, course and eyes under a condition.

    Args:
        condition: A name of CONDITIONS, or such values.
        scene: The place without the condition.
        course: The course's settings without it.
        eyes: The eyes without it.

    Raises:
        ValueError: A name is unknown, or a value is out of its range; the message names it.
    """
    values = condition_values(condition)
    if "scene" in values:
        if not isinstance(values["scene"], str | Path):
            raise ValueError(f"scene must be a preset or the JSON file of a place, got {values['scene']!r}")
        scene = load_place(values["scene"])
    return (
        with_look(scene, {name: value for name, value in values.items() if name in LOOK_LIMITS}),
        course_under(values, course),
        replace(eyes, **{name: value for name, value in values.items() if name in OF_EYES}),
    )


def course_under(values: Values, course: CourseConfig) -> CourseConfig:
    """Return a course's settings under the values of a condition.

    Raises:
        ValueError: A value is out of its range.
    """
    replaced = {name: value for name, value in values.items() if name in OF_COURSE}
    if "sun_elevation_deg" in values:
        replaced["sun_elevation_deg"] = None  # the place's look has it
    return replace(course, **replaced)


def with_look(scene: SceneConfig, look: Mapping[str, float]) -> SceneConfig:
    """Return a place with fixed values of its LookConfig, by their names, instead of the ranges.

    Raises:
        ValueError: A value is no number, or is out of its range.
    """
    if not look:
        return scene
    for name, value in look.items():
        if isinstance(value, bool) or not isinstance(value, Real):
            raise ValueError(f"{name} must be a number, got {value!r}")
    fixed: LookConfig = replace(scene.look, **{name: (value, value) for name, value in look.items()})
    return replace(scene, look=fixed)
