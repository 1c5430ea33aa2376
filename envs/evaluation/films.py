"""The films of an evaluation: of its best and its worst drive, and of the courses that are asked for."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

from envs.drivers.driver import Driver
from envs.drives.episodes import EpisodeRecord
from envs.drives.metrics import best_and_worst
from envs.evaluation.config import EvaluateConfig, Task
from envs.evaluation.driving import drive
from envs.evaluation.resume import Provenance, unchanged
from envs.mars_nav import MarsNavEnv
from envs.recording.results_page import BEST, FILMED, WORST
from marssim.base.command.progress import progress
from marssim.base.files.atomic import written_atomically
from marssim.base.files.json_file import read_json, write_json


def make_films(
    config: EvaluateConfig, tasks: Sequence[Task], records: Sequence[EpisodeRecord], provenance: Provenance
) -> None:
    """Make the films that are asked for and missing; tasks: those of the records, in their order."""
    films = _films(config, tasks, records)
    noted = config.out / FILMED
    filmed = read_json(noted) if noted.is_file() else {}
    if config.videos:
        for name in {BEST, WORST} & filmed.keys() - films.keys():  # of an earlier run with other drives
            (config.out / name).unlink(missing_ok=True)
            del filmed[name]
            write_json(noted, filmed)
    for name, (words, n) in films.items():
        path, task = config.out / name, tasks[n]
        if filmed.get(name) == task.file and path.is_file():
            continue
        path.parent.mkdir(exist_ok=True)
        write_json(noted, {other: file for other, file in filmed.items() if other != name})  # until it is whole
        same = [other for other, file in filmed.items() if file == task.file and other != name]
        if same and (config.out / same[0]).is_file():
            with written_atomically(path) as part:
                shutil.copy(config.out / same[0], part)
        else:
            with unchanged(config, (task.driver, task.perception), provenance):
                _film_drive(config, task, path, f"filming {words}", records[n].steps)
        filmed[name] = task.file
        write_json(noted, filmed)


def _films(
    config: EvaluateConfig, tasks: Sequence[Task], records: Sequence[EpisodeRecord]
) -> dict[str, tuple[str, int]]:
    """Return the films that are asked for: by the file in OUT, what it shows in words, and the index of the drive.

    There is no film of the best drive if none arrived, and none of the worst one if that is the best one too.
    """
    films = {}
    if config.videos:
        best, worst = best_and_worst(records)
        if best is not None:
            films[BEST] = "best drive", best
        if worst != best:
            films[WORST] = "worst drive", worst
    for n, task in enumerate(tasks):
        if task.episode in config.film_courses:
            words = f"course {task.episode}, {task.cell.name}, {task.driver}, {task.perception}"
            films[f"videos/{Path(task.file).stem}.mp4"] = words, n
    return films


def _film_drive(config: EvaluateConfig, task: Task, path: Path, progress_task: str, steps: int) -> None:
    """Drive an episode again and film it; steps: those of its record."""
    from envs.drives.film import Film

    title = f"{task.driver}, {task.perception}: course {task.episode}, {task.cell.name}"
    with progress(steps + 1, "step", progress_task) as bar, Film(path, title) as film:
        filmed = -1  # the last step, which comes twice where the driver ends the drive

        def watch(env: MarsNavEnv, driver: Driver, step: int) -> None:
            nonlocal filmed
            film.watch(env, driver, step)
            bar.update(step - filmed)
            filmed = step

        drive(config, task, watch)


def delete_films(out: Path, task: Task) -> None:
    """Delete the films of an episode, so that those that are asked for are made again."""
    noted = out / FILMED
    filmed = read_json(noted) if noted.is_file() else {}
    if old := [name for name, file in filmed.items() if file == task.file]:
        for name in old:
            (out / name).unlink(missing_ok=True)
        write_json(noted, {name: file for name, file in filmed.items() if name not in old})
