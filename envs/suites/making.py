"""Draws the courses of a suite, and records what identifies each."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any

from envs.courses.course import series_seed
from envs.suites.conditions import CONDITIONS, OF_EYES, Values
from envs.suites.drawn_sensor import sensor_values
from envs.suites.suite import FORMAT, build_course, build_sensor, course_values
from envs.world.eyes import EyesConfig
from marssim.base.version import RELEASE

# What all conditions start from: as many rocks as at Viking 2, so that a rover has to steer round them
BASE: Values = {"scene": "utopia", "k": 0.15}
DRIVE = {"dynamics": "kinematic", "renderer": "embree", "align_rows": True, "slip": None}
SEEDS = {"dev": 1001, "test": 2002}


def suite_conditions(base: Values = BASE) -> dict[str, Values]:
    """Return the values of every condition. The true depth has the pixels of the eyes, to which it is compared."""
    out: dict[str, Values] = {}
    for name, changes in CONDITIONS.items():
        values = {**base, **changes}
        pixels = values.get("image_pixels", EyesConfig.image_pixels)
        out[name] = {**values, "ground_truth_pixels": pixels}
    return out


def make_suite(
    name: str,
    splits: Mapping[str, Mapping[str, int]],
    conditions: Mapping[str, Values],
    drive: Mapping[str, Any] = DRIVE,
    advance: Callable[[], object] = lambda: None,
) -> dict[str, Any]:
    """Return the content of a suite's file.

    Args:
        name: Name of the suite.
        splits: Seed and number of courses by the split's name.
        conditions: Values by the condition's name.
        drive: Settings of every drive.
        advance: Is called after each episode.
    """
    episodes = []
    for split, values in splits.items():
        for number in range(values["courses"]):
            seed = series_seed(values["seed"], number)
            drawn: dict[str, dict[str, Any]] = {}  # the eyes do not change the scene
            for condition, settings in conditions.items():
                of_scene = {key: value for key, value in settings.items() if key not in OF_EYES}
                key = json.dumps(of_scene, sort_keys=True)
                if key not in drawn:
                    drawn[key] = course_values(build_course(of_scene, seed))
                episode = {"split": split, "condition": condition, "course": number, "seed": seed}
                sensor = sensor_values(build_sensor(settings, seed))
                episodes.append(episode | drawn[key] | {"sensor": sensor})
                advance()
    return {
        "suite": name, "format": FORMAT, "made_with": RELEASE, "drive": dict(drive), "splits": dict(splits),
        "conditions": dict(conditions), "episodes": episodes,
    }  # fmt: skip


def suite_text(content: Mapping[str, Any]) -> str:
    """Return a suite's file, with an episode and a condition a line."""
    lines = []
    for key, value in content.items():
        if key == "episodes":
            rows = ",\n".join(f"  {json.dumps(episode)}" for episode in value)
            lines.append(f' "episodes": [\n{rows}\n ]')
        elif key in ("conditions", "splits"):
            rows = ",\n".join(f"  {json.dumps(name)}: {json.dumps(values)}" for name, values in value.items())
            lines.append(f' "{key}": {{\n{rows}\n }}')
        else:
            lines.append(f" {json.dumps(key)}: {json.dumps(value)}")
    return "{\n" + ",\n".join(lines) + "\n}\n"
