"""An evaluation on a suite: what the suite fixes of its settings, and what its results say beside the table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from envs.drivers.driver import Driver
from envs.drives.episodes import Cell, EpisodeRecord, Watch
from envs.drives.metrics import spl
from envs.evaluation.config import EvaluateConfig
from envs.mars_nav import MarsNavEnv
from envs.suites.conditions import condition_values
from envs.suites.suite import Suite, load_suite
from marssim.base.command.spelling import did_you_mean

# What remains free with --suite; everything else is the suite's.
FREE = (
    "out", "driver", "perception", "workers", "scheduler", "runtime", "scores", "videos", "film_courses", "bag_courses",
    "record", "condition", "suite", "split", "shard", "episodes",
)  # fmt: skip


def with_suite(config: EvaluateConfig) -> EvaluateConfig:
    """Return the settings with all that their suite fixes; unchanged without a suite.

    Raises:
        DatasetError: The suite cannot be read.
        ValueError: A flag is set that the suite fixes, or split or condition is unknown; the message names it.
    """
    if config.suite is None:
        return config
    suite = load_suite(config.suite)
    suite.check_split(config.split)
    if name := _fixed_flag(config):
        raise ValueError(f"`{name}`: {suite.name} fixes it; leave it out with --suite")
    for name in config.condition:
        if name not in suite.conditions:
            conditions = ", ".join(suite.conditions)
            hint = did_you_mean(name, list(suite.conditions))
            raise ValueError(f"--condition {name!r} is unknown{hint}; {suite.name} has {conditions}")
    most = suite.splits[config.split]["courses"]
    if config.episodes is not None and config.episodes > most:
        raise ValueError(f"--episodes must be at most {most}, as many as {suite.name} has, got {config.episodes}")
    return replace(
        config, **_fixed_by(suite, config.split), condition=config.condition or tuple(suite.conditions),
        episodes=config.episodes or most,
    )  # fmt: skip


def fixed_settings(suite: Suite, split: str) -> dict[str, Any]:
    """Return all settings that a suite fixes by their names, those of the eyes among them.

    Args:
        suite: The suite.
        split: Name of one of its splits.
    """
    return {**_settings(EvaluateConfig(Path())), **_fixed_by(suite, split)}


def _fixed_by(suite: Suite, split: str) -> dict[str, Any]:
    """Return the settings that the file of a suite holds; all others that it fixes have their defaults."""
    return {**suite.drive, "seed": suite.splits[split]["seed"]}


def _fixed_flag(config: EvaluateConfig) -> str | None:
    """Return the name of a flag that is set although a suite fixes it; None if there is none."""
    given, plain = _settings(config), _settings(EvaluateConfig(config.out))
    return next((name for name in given if given[name] != plain[name]), None)


def _settings(config: EvaluateConfig) -> dict[str, Any]:
    """Return the settings by name that do not remain free with a suite."""
    others = {name: value for name, value in vars(config).items() if name not in (*FREE, "eyes")}
    return {**vars(config.eyes), **others}


def values_of(config: EvaluateConfig, cell: Cell) -> Mapping[str, Any]:
    """Return the values of a cell's condition: those of the suite, of the name, or none."""
    if cell.condition is None:
        return {}
    if config.suite is None:
        return condition_values(cell.condition)
    return load_suite(config.suite).conditions[cell.condition]


def episode_check(config: EvaluateConfig, cell: Cell, number: int, then: Watch) -> Watch:
    """Return a Watch that compares the course and the detectors with the suite's after the reset, and calls `then`.

    It raises DatasetError if they differ. Without a suite it is `then`.
    """
    if config.suite is None:
        return then
    suite = load_suite(config.suite)

    def watch(env: MarsNavEnv, driver: Driver, step: int) -> None:
        if step == 0:
            sensor = env.perception.sensor
            assert env.course is not None and sensor is not None and cell.condition is not None
            suite.check_episode(config.split, cell.condition, number, env.course, sensor)
        then(env, driver, step)

    return watch


def suite_results(config: EvaluateConfig, records: Sequence[EpisodeRecord]) -> dict[str, Any]:
    """Return what results.json holds of a suite: which one, its conditions, and every episode; nothing without."""
    if config.suite is None:
        return {}
    suite = load_suite(config.suite)
    return {
        "suite": {
            "name": suite.name, "sha256": suite.sha256, "split": config.split, "conditions": list(config.condition),
            "courses": config.episodes, "shard": config.shard,
        },
        "episodes": [_episode(record) for record in records],
    }  # fmt: skip


def _episode(record: EpisodeRecord) -> dict[str, Any]:
    success = record.outcome == "goal"
    return {
        "condition": record.cell.removeprefix("condition="), "course": record.episode, "driver": record.driver,
        "perception": record.perception, "outcome": record.outcome, "cause": record.cause,
        "success": success, "spl": spl(success, record.shortest, record.path_length), "shortest": record.shortest,
        "path_length": record.path_length, "distance": record.distance, "start_distance": record.start_distance,
        "steps": record.steps, "looks": record.looks, "abs_rel": record.abs_rel, "blind": record.blind,
        "rocks": record.rocks, "rocks_missed": record.rocks_missed, "false_obstacles": record.false_obstacles,
        "near_ground": record.near_ground, "near_ground_as_sky": record.near_ground_as_sky,
        "slip": record.slip, "energy": record.energy, "min_clearance": record.min_clearance,
        "step_seconds": record.step_seconds, "perception_seconds": record.perception_seconds, "code": record.code,
    }  # fmt: skip
