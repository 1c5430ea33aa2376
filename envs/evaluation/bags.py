"""The bags of an evaluation: its courses of --bag-courses, driven again, as ROS 2 bags."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

from envs.drivers.driver import Driver
from envs.drives.drive_bag import DriveBag
from envs.drives.episodes import EpisodeRecord
from envs.evaluation.config import EvaluateConfig, Task
from envs.evaluation.driving import drive
from envs.evaluation.resume import Provenance, unchanged
from envs.mars_nav import MarsNavEnv
from marssim.base.command.progress import progress


def write_bags(
    config: EvaluateConfig, tasks: Sequence[Task], records: Sequence[EpisodeRecord], provenance: Provenance
) -> None:
    """Drive the courses of --bag-courses again and write their bags, those that are missing."""
    for task, record in zip(tasks, records, strict=True):
        path = _bag_path(config.out, task)
        if task.episode not in config.bag_courses or path.is_dir():
            continue
        words = f"bag of course {task.episode}, {task.cell.name}, {task.driver}, {task.perception}"
        with progress(record.steps + 1, "step", words) as bar, DriveBag(path) as bag:

            def watch(env: MarsNavEnv, driver: Driver, step: int) -> None:
                bag.watch(env, driver, step)
                bar.update()

            with unchanged(config, (task.driver, task.perception), provenance):
                bag.end(drive(config, task, watch).outcome)


def delete_bag(out: Path, task: Task) -> None:
    """Delete the bag of an episode, so that it is written again if it is asked for."""
    if (bag := _bag_path(out, task)).is_dir():
        shutil.rmtree(bag)


def _bag_path(out: Path, task: Task) -> Path:
    """Return the folder of the bag of an episode."""
    return out / "bags" / Path(task.file).stem
