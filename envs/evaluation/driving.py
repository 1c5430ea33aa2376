"""One drive of an evaluation: its driver, its environment, its record, and the file that records it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from envs.drivers.by_name import make_driver
from envs.drives.episodes import EpisodeRecord, Watch, run_episode
from envs.drives.records import DELETE_TO_REPEAT, read_record
from envs.drives.step_lines import StepLines
from envs.evaluation.config import EvaluateConfig, Task
from envs.evaluation.resume import check_paths, check_worker, unchanged
from envs.evaluation.suite_drives import episode_check, values_of
from envs.mars_nav import MarsNavEnv
from envs.recording.drive_page import drive_path
from envs.recording.recorder import Recorder
from envs.world.loaded_methods import loaded_method
from envs.world.vehicle import checked_dynamics
from marssim.base.command.wording import counted
from marssim.base.compute.one_thread import one_thread
from marssim.base.files.json_file import DatasetError


def drive_recorded(
    config: EvaluateConfig, task: Task, runtime: str | None, provenance: Mapping[str, Any], folder: Path
) -> tuple[EpisodeRecord, bytes | None]:
    """Drive one episode, and return its record and, if --record asks for that, the content of the file of its drive.

    Args:
        config: The settings.
        task: The episode.
        runtime: What must run its perception, see resume.check_worker.
        provenance: Settings, and digests of the files of drivers and perceptions, see resume.unchanged.
        folder: The folder in which the command was started.
    """
    check_paths(config, (task.driver, task.perception), folder)
    check_worker(task.perception, config.runtime, runtime)
    recorder = None if config.record == "none" else Recorder(_step_lines(config, task))
    with unchanged(config, (task.driver, task.perception), provenance):
        record = drive(config, task, None if recorder is None else recorder.watch)
    if recorder is None:
        return record, None
    record = replace(record, cause=recorder.cause)
    if config.record == "failures" and record.outcome == "goal":
        return record, None
    return record, recorder.drive_file(record, provenance["driven_with"])


def drive(config: EvaluateConfig, task: Task, watch: Watch | None = None) -> EpisodeRecord:
    """Drive one episode and return its record.

    It computes in one thread, so that the drive is the same in this process and in a worker.

    Args:
        config: The settings.
        task: The episode.
        watch: Is called after the reset and after every step, as run_episode describes. None: prints the progress.
    """
    driver = make_driver(task.driver)
    watch = episode_check(config, task.cell, task.episode, watch or _step_lines(config, task))
    perception = loaded_method(task.perception, config.runtime)
    env = MarsNavEnv(
        perception, checked_dynamics(config.dynamics), config.renderer,
        config.scene_config(), config.goal_distance,
        mast=True, map_observation=bool(getattr(driver, "needs_map", False)),
        disparity_noise=config.disparity_noise, drift=config.drift, yaw_drift_deg=config.yaw_drift_deg,
        align_rows=config.align_rows, slip=config.slip_config(), eyes=config.eyes,
        # The flags of the look are of the place, and of one that a condition takes instead.
        condition={
            **config.look_flags(), "into_sun": config.into_sun, "ditch": config.ditch, **values_of(config, task.cell),
        },
    )  # fmt: skip
    try:
        with one_thread():
            return run_episode(env, driver, task.cell, config.seed, task.episode, (task.driver, task.perception), watch)
    finally:
        env.close()


def _step_lines(config: EvaluateConfig, task: Task) -> Watch:
    name = f"course {task.episode}, {task.cell.name}, {task.driver}, {task.perception}"
    return StepLines(name, lambda: drives_done(config)).watch


def drives_done(config: EvaluateConfig) -> str:
    """Return how many drives are finished, as a worker sees it from the files."""
    files = config.out / "episodes"
    done = sum((files / task.file).is_file() and not lacks_drive(config, task) for task in config.tasks)
    return f"{done} of {counted(len(config.tasks), 'drive')} done"


def lacks_drive(config: EvaluateConfig, task: Task) -> bool:
    """Return whether --record asks for the drive of a finished episode, and it was not recorded."""
    if config.record == "none" or drive_path(config.out, task.file).is_file():
        return False
    return config.record == "all" or record_of_task(config, task).outcome != "goal"


def record_of_task(config: EvaluateConfig, task: Task) -> EpisodeRecord:
    """Return the record of a finished episode.

    Raises:
        DatasetError: It is missing, damaged, or of another episode.
    """
    path = config.out / "episodes" / task.file
    record = read_record(path)
    if not task.is_of(record):
        actual = f"{record.driver}, {record.perception}, course {record.episode}"
        raise DatasetError(f"{path}: is the record of {actual}{DELETE_TO_REPEAT}")
    return record
