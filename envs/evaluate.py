"""Score drivers and perceptions on frozen episodes of MarsNav-v0.

    python -m envs.evaluate --driver navigator --perception m3depth --episodes 10 --seed 1 --out out/eval
    python -m envs.evaluate --driver navigator straight --perception ground_truth --dynamics kinematic --grid \\
        --episodes 50 --workers 2 --out out/grid

    python -m envs.evaluate --suite marsnav-v1 --split dev --perception ground_truth sgbm --out out/suite

All drivers and perceptions drive the same courses. Finished episodes stay in OUT/episodes: the same command continues
where it was stopped.
"""

from __future__ import annotations

import shutil
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from itertools import product
from pathlib import Path
from typing import Any

from envs.drivers.by_name import make_driver
from envs.drivers.driver import Driver
from envs.drives.config import EvaluateConfig, Task
from envs.drives.drive_bag import DriveBag
from envs.drives.episodes import EpisodeRecord, Watch, run_episode
from envs.drives.metrics import best_and_worst, paired_difference, summarise
from envs.drives.records import DELETE_TO_REPEAT, holds_drive, read_record
from envs.drives.report import without_definitions, write_report
from envs.drives.resume import (
    NOTES,
    Provenance,
    check_paths,
    check_worker,
    note_drives_left_out,
    note_provenance,
    unchanged,
)
from envs.drives.step_lines import StepLines
from envs.drives.suite_drives import episode_check, suite_results, values_of, with_suite
from envs.drives.test_set_errors import errors_on_test_set
from envs.mars_nav import MarsNavEnv
from envs.recording.drive_page import DRIVES, drive_path, write_drive_pages
from envs.recording.recorder import Recorder
from envs.recording.results_page import BEST, FILMED, WORST, write_results_page
from envs.world.loaded_methods import loaded_method
from envs.world.perception import perception_digest
from envs.world.vehicle import checked_dynamics, chosen_dynamics
from m3depth.runtimes.choice import recorded_runtime
from marssim.base.bags.library import check_installed
from marssim.base.command.progress import progress
from marssim.base.command.run import run_command
from marssim.base.command.wording import counted
from marssim.base.compute.one_thread import one_thread
from marssim.base.compute.workers import run_tasks
from marssim.base.files.atomic import write_atomically, written_atomically
from marssim.base.files.json_file import DatasetError, as_json, read_json, write_json
from marssim.base.results.claim import PARTIAL, ResultFolder

SETTINGS = "evaluate.json"  # file in OUT with the settings of its episodes


def evaluate(config: EvaluateConfig) -> dict[str, Any]:
    """Drive the episodes that are missing, write the report, and return the content of results.json.

    Raises:
        DatasetError: If the folder holds episodes of other settings, or anything else.
        FolderInUse: If another command writes to the folder.
        ImportError: If a bag is asked for, and `rosbags` is not installed.
        ValueError: If a perception or a driver is unknown.
    """
    config = with_suite(config)
    config = replace(config, dynamics=chosen_dynamics(config.dynamics)).with_true_pixels()
    for name in config.perception:
        loaded_method(name, config.runtime)  # an unknown name is reported before anything is written or started
    for name in config.driver:
        make_driver(name)
    if config.bag_courses:
        check_installed(config.out / "bags")
    test_errors = errors_on_test_set(config.scores, {name: perception_digest(name) for name in config.perception})
    config.check_shard()
    results = ResultFolder(
        config.out, "evaluation", SETTINGS, config.content(), notes=NOTES, partial=(f"**/{PARTIAL}",)
    )
    with results.claim():
        folder = config.out / "episodes"
        missing = [task for task in config.tasks if not (folder / task.file).is_file() or _lacks_drive(config, task)]
        provenance = note_provenance(results, config, bool(missing))
        folder.mkdir(exist_ok=True)
        return _evaluate(config, missing, provenance, test_errors)


def _evaluate(
    config: EvaluateConfig, missing: list[Task], provenance: dict[str, Any], test_errors: dict[str, float]
) -> dict[str, Any]:
    """Drive the missing episodes, and write what evaluate returns, with the films and the bags."""
    tasks = config.tasks
    _run(config, missing, provenance)
    content, records = write_results(config, provenance, test_errors)
    _film(config, tasks, records, provenance)
    write_results_page(config.out, content, records, [task.file for task in tasks])  # again, with the films
    _write_bags(config, tasks, records, provenance)
    return content


def write_results(
    config: EvaluateConfig, provenance: Mapping[str, Any], test_errors: Mapping[str, float]
) -> tuple[dict[str, Any], list[EpisodeRecord]]:
    """Write results.json, results.md, the plots and the maps from the records of all episodes.

    Args:
        config: The settings.
        provenance: Entries of results.json: settings, digests of files, runtime and versions.
        test_errors: Abs Rel of perceptions on their test set.

    Returns:
        The content of results.json, and the records.

    Raises:
        DatasetError: A record is missing, damaged, or of another episode.
    """
    records = [_read_record(config.out / "episodes", task) for task in config.tasks]
    content = {
        "config": as_json(asdict(config)),
        **provenance,
        "code": dict(Counter(record.code for record in records)),
        "test_set_abs_rel": test_errors,
        "results": _results(config, records),
        "differences": _differences(config, records),
        **suite_results(config, records),
    }
    write_json(config.out / "results.json", content)
    write_report(config.out, content, records)
    for broken in write_drive_pages(config.out / DRIVES)[1]:
        print(f"warning: {broken}", file=sys.stderr)
    write_results_page(config.out, content, records, [task.file for task in config.tasks])
    return content, records


def _results(config: EvaluateConfig, records: Sequence[EpisodeRecord]) -> list[dict[str, Any]]:
    """Return a row for each cell, driver and perception."""
    rows = []
    for cell in config.cells:
        for driver, perception in product(config.driver, config.perception):
            drives = [r for r in records if (r.driver, r.perception, r.cell) == (driver, perception, cell.name)]
            if drives:  # a shard may have none
                rows.append({"driver": driver, "perception": perception, "cell": cell.content(), **summarise(drives)})
    return rows


def _differences(config: EvaluateConfig, records: Sequence[EpisodeRecord]) -> list[dict[str, Any]]:
    """Return success and SPL of every driver and perception less those of the first, paired, over all cells."""
    groups = list(product(config.driver, config.perception))
    drives = {group: [r for r in records if (r.driver, r.perception) == group] for group in groups}
    first = groups[0]
    return [
        {
            "driver": group[0], "perception": group[1], "less": list(first),
            **paired_difference(drives[group], drives[first]),
        }
        for group in groups[1:]
    ]  # fmt: skip


def _film(
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


def _write_bags(
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


def _delete_films_and_bag(out: Path, task: Task) -> None:
    """Delete the films and the bag of an episode, so that those that are asked for are made again."""
    noted = out / FILMED
    filmed = read_json(noted) if noted.is_file() else {}
    if old := [name for name, file in filmed.items() if file == task.file]:
        for name in old:
            (out / name).unlink(missing_ok=True)
        write_json(noted, {name: file for name, file in filmed.items() if name not in old})
    if (bag := _bag_path(out, task)).is_dir():
        shutil.rmtree(bag)


def _bag_path(out: Path, task: Task) -> Path:
    """Return the folder of the bag of an episode."""
    return out / "bags" / Path(task.file).stem


def _lacks_drive(config: EvaluateConfig, task: Task) -> bool:
    """Return whether --record asks for the drive of a finished episode, and it was not recorded."""
    if config.record == "none" or drive_path(config.out, task.file).is_file():
        return False
    return config.record == "all" or _read_record(config.out / "episodes", task).outcome != "goal"


def _run(config: EvaluateConfig, tasks: list[Task], provenance: Mapping[str, Any]) -> None:
    with progress(len(tasks), "episode", "drive") as bar:

        def finished(arguments: Sequence[Any], driven: tuple[EpisodeRecord, bytes | None]) -> None:
            (record, data), task = driven, arguments[1]
            path, recorded = config.out / "episodes" / task.file, drive_path(config.out, task.file)
            if not holds_drive(path, record):
                _delete_films_and_bag(config.out, task)  # of an earlier drive
            if data is None:
                for file in (recorded, recorded.with_suffix(".html")):
                    file.unlink(missing_ok=True)
            else:  # before the record, so that a finished episode has its drive
                write_atomically(recorded, data)
            write_json(path, asdict(record))
            bar.update()

        runtimes = {name: recorded_runtime([name], config.runtime) for name in config.perception}
        absolute = replace(config, out=config.out.absolute())  # a worker may run in another folder
        arguments = [(absolute, task, runtimes[task.perception], provenance, Path.cwd()) for task in tasks]
        run_tasks(drive_recorded, arguments, finished, config.workers, config.scheduler)


def _read_record(folder: Path, task: Task) -> EpisodeRecord:
    path = folder / task.file
    record = read_record(path)
    if not task.is_of(record):
        actual = f"{record.driver}, {record.perception}, course {record.episode}"
        raise DatasetError(f"{path}: is the record of {actual}{DELETE_TO_REPEAT}")
    return record


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
    return StepLines(name, lambda: _drives_done(config)).watch


def _drives_done(config: EvaluateConfig) -> str:
    """Return how many drives are finished, as a worker sees it from the files."""
    files = config.out / "episodes"
    done = sum((files / task.file).is_file() and not _lacks_drive(config, task) for task in config.tasks)
    return f"{done} of {counted(len(config.tasks), 'drive')} done"


def main(args: Sequence[str] | None = None) -> int:
    """Run the command and return the exit code."""
    return run_command(_work, EvaluateConfig, "python -m envs.evaluate", __doc__, args)


def _work(config: EvaluateConfig) -> None:
    content = evaluate(config)
    page = config.out / "results.md"
    print(without_definitions(page.read_text(encoding="utf-8")).rstrip(), end="\n\n")
    rows = counted(len(content["results"]), "row")
    print(
        f"{rows} in {config.out / 'results.json'}, drives in {config.out / 'maps'}, for the browser in "
        f"{config.out / 'results.html'}; {page} defines the columns"
    )
    note_drives_left_out(with_suite(config))


if __name__ == "__main__":
    from envs.evaluate import main as command  # not __main__, so that workers elsewhere can import what is pickled

    sys.exit(command())
