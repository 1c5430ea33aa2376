"""A suite: a versioned list of episodes that everyone drives over the same ground.

A suite is one JSON file:

    suite         its name, with its version
    format        1, the version of this layout
    made_with     the release of the simulator that builds its scenes
    drive         dynamics, renderer, align_rows and slip of every drive
    splits        by name: the seed of its courses, and how many there are
    conditions    by name: the values under which it is driven (envs.suites.conditions)
    episodes      one for each split, condition and course: the seed of the scene, start [x m, y m, yaw rad], goal [x m,
                  y m], length of the shortest path [m], the two digests of the scene's ground and rocks
                  (envs.suites.digest), its look: sun, air and surface (envs.suites.drawn_look), and its sensor: what is
                  wrong with rig and lenses (envs.suites.drawn_sensor)

suite.schema.json beside this file describes every value. Names become parts of file names and of pages, so they have
letters, digits, "_", "." and "-" only.

Courses of one number have the same seed under all conditions. The splits "dev" and "test" share no seed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from envs.courses.course import Course, CourseConfig, draw_course, series_seed
from envs.suites.conditions import Values, under
from envs.suites.digest import scene_digests
from envs.suites.drawn_look import look_values, same_look
from envs.suites.drawn_sensor import draw_sensor, same_sensor, sensor_values
from envs.world.eyes import EyesConfig
from marssim.base.files.json_file import DatasetError, read_json
from marssim.base.files.json_schema import first_fault
from marssim.base.rover_spec import ZHURONG
from marssim.render.sensor import Sensor
from marssim.scene.presets import PRESETS, preset
from marssim.scene.scene import SceneConfig

FORMAT = 1
FOLDER = Path(__file__).parent  # of the suites in the package
SCHEMA = FOLDER / "suite.schema.json"
OVERALL = "all"  # in tables, the row of all conditions
SAME_PLACE = 2e-3  # [m], [rad] by which start and goal may differ
SAME_WAY = 0.02  # [m] by which the shortest path may differ


@dataclass(frozen=True)
class Suite:
    """The content of a suite's file."""

    name: str
    """Its name, with its version."""
    sha256: str
    """SHA-256 of the file."""
    made_with: str
    """Release of the simulator that builds its scenes."""
    drive: Mapping[str, Any]
    """Settings of every drive: dynamics, renderer, align_rows and slip."""
    splits: Mapping[str, Mapping[str, int]]
    """Seed and number of courses by the split's name."""
    conditions: Mapping[str, Values]
    """Values by the condition's name."""
    episodes: Mapping[tuple[str, str, int], Mapping[str, Any]]
    """Values of an episode as the file has them, by its split, condition and course."""

    def check_split(self, split: str) -> None:
        """Raise ValueError that names --split if the suite has no such split."""
        if split not in self.splits:
            raise ValueError(f"`split` {split!r} is unknown; suite {self.name} has {', '.join(self.splits)}")

    def check_episode(self, split: str, condition: str, number: int, course: Course, sensor: Sensor) -> None:
        """Compare an episode that the simulator built with that of the suite.

        Args:
            split: Name of the split.
            condition: Name of the condition.
            number: Number of the course.
            course: The course that was built.
            sensor: The detectors that were drawn.

        Raises:
            DatasetError: They differ. One line that says in what.
        """
        episode = self.episodes[split, condition, number]
        built = course_values(course) | {"sensor": sensor_values(sensor)}
        if differing := [name for name in built if not _same(name, built, episode)]:
            raise DatasetError(
                f"suite {self.name}: course {number} of {split}, {condition}, is not the one that this simulator "
                f"builds (another {', '.join(differing)}); drive it with release {self.made_with}, which made the "
                "suite, or take a newer suite"
            )


def packaged_suites() -> list[str]:
    """Return the names of the suites in the package."""
    return sorted(file.stem for file in FOLDER.glob("*-v*.json"))


def load_suite(name: str, setting: str = "suite") -> Suite:
    """Read a suite.

    Args:
        name: Name of a suite in the package, or path of a JSON file.
        setting: What the user named it by, for errors.

    Raises:
        DatasetError: There is no such suite, or its file is none. One line that names the file and the field.
    """
    path = Path(name) if name.endswith(".json") else FOLDER / f"{name}.json"
    if not name.endswith(".json") and name not in (names := packaged_suites()):
        raise DatasetError(
            f"`{setting}` {name!r} is unknown; the package has {', '.join(names)}, or give the path of a JSON file"
        )
    try:
        stamp = path.stat().st_mtime_ns
    except OSError:
        raise DatasetError(f"suite {path}: no such file") from None
    return _read(path, stamp)


def suite_note(name: str, split: str) -> dict[str, str]:
    """Return suite and split as a result folder notes them."""
    suite = load_suite(name)
    return {"suite": suite.name, "suite_sha256": suite.sha256, "split": split}


def build_course(values: Values, seed: int) -> Course:
    """Build the course of an episode.

    Args:
        values: Of the condition.
        seed: Of the scene.
    """
    scene, config, _ = _settings_under({**values, "scene_seed": seed})
    return draw_course(scene, config, ZHURONG, np.random.default_rng(seed))


def build_sensor(values: Values, seed: int) -> Sensor:
    """Draw the detectors of an episode.

    Args:
        values: Of the condition.
        seed: Of the scene.
    """
    _, _, eyes = _settings_under(values)
    return draw_sensor(eyes, seed)


def course_values(course: Course) -> dict[str, Any]:
    """Return what a suite holds of a course: start, goal, shortest, scene and look."""
    return {
        "start": [round(float(value), 3) for value in course.start],
        "goal": [round(float(value), 3) for value in course.goal],
        "shortest": round(course.shortest, 3),
        "scene": list(scene_digests(course.scene)),
        "look": look_values(course.scene.look),
    }


def _settings_under(values: Values) -> tuple[SceneConfig, CourseConfig, EyesConfig]:
    """Return place, course and eyes of a suite's condition. Raises ValueError for a value that cannot be driven."""
    return under(values, preset(PRESETS[0]), CourseConfig(), EyesConfig())


def _same(name: str, built: Mapping[str, Any], episode: Mapping[str, Any]) -> bool:
    if name == "scene":
        return any(a == b for a, b in zip(built["scene"], episode["scene"], strict=True))
    if name == "look":
        return same_look(built["look"], episode["look"])
    if name == "sensor":
        return same_sensor(built["sensor"], episode["sensor"])
    most = SAME_WAY if name == "shortest" else SAME_PLACE
    return bool(np.abs(np.subtract(built[name], episode[name])).max() <= most)


@lru_cache(maxsize=4)
def _read(path: Path, stamp: int) -> Suite:
    """Read a suite's file; stamp: its time of change, so that a changed file is read again."""
    content = read_json(path)
    if isinstance(content.get("suite"), dict):
        raise DatasetError(f"suite {path}: is a file of results, not of a suite")
    if fault := first_fault(content, suite_schema()):
        raise DatasetError(f"suite {path}: {fault}")
    for part in ("conditions", "splits"):
        if not content[part]:
            raise DatasetError(f"suite {path}: {part} must not be empty")
    if OVERALL in content["conditions"]:
        raise DatasetError(f"suite {path}: conditions: {OVERALL} is the name of all of them together; choose another")
    for name, values in content["conditions"].items():
        try:
            _settings_under(values)
        except ValueError as error:
            raise DatasetError(f"suite {path}: conditions, {name}: {str(error).replace('`', '')}") from None
    episodes: dict[tuple[str, str, int], Mapping[str, Any]] = {}
    for n, each in enumerate(content["episodes"]):
        key = each["split"], each["condition"], each["course"]
        if key in episodes:
            raise DatasetError(f"suite {path}: course {key[2]} of {key[0]}, {key[1]}, appears twice")
        if key[0] not in content["splits"] or key[1] not in content["conditions"]:
            raise DatasetError(
                f"suite {path}: episodes[{n}] is of {key[0]}, {key[1]}, which the file does not describe"
            )
        if key[2] >= (courses := content["splits"][key[0]]["courses"]):
            raise DatasetError(
                f"suite {path}: episodes[{n}].course must be below {courses}, the number of courses of {key[0]}, got "
                f"{key[2]}"
            )
        if each["seed"] != (seed := series_seed(content["splits"][key[0]]["seed"], key[2])):
            raise DatasetError(
                f"suite {path}: episodes[{n}].seed must be {seed}, as follows from that of {key[0]}, got {each['seed']}"
            )
        episodes[key] = each
    for split, values in content["splits"].items():
        for condition in content["conditions"]:
            for course in range(values["courses"]):
                if (split, condition, course) not in episodes:
                    raise DatasetError(f"suite {path}: course {course} of {split}, {condition}, is missing")
    sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
    return Suite(
        content["suite"], sha256, content["made_with"], content["drive"], content["splits"], content["conditions"],
        episodes,
    )  # fmt: skip


@cache
def suite_schema() -> dict[str, Any]:
    """Return the JSON schema of a suite's file."""
    return read_json(SCHEMA)
