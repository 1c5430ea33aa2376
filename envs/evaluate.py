"""Score drivers and perceptions on frozen episodes of MarsNav-v0.

    python -m envs.evaluate --driver navigator --perception m3depth --episodes 10 --seed 1 --out out/eval
    python -m envs.evaluate --driver navigator straight --perception ground_truth --dynamics kinematic --grid \\
        --episodes 50 --workers 2 --out out/grid

    python -m envs.evaluate --suite marsnav-v1 --split dev --perception ground_truth sgbm --out out/suite

All drivers and perceptions drive the same courses. Finished episodes stay in OUT/episodes: the same command continues
where it was stopped.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from envs.drivers.by_name import make_driver
from envs.drives.episodes import EpisodeRecord
from envs.drives.records import holds_drive
from envs.drives.report import without_definitions
from envs.evaluation.bags import delete_bag, write_bags
from envs.evaluation.config import SETTINGS, EvaluateConfig, Task
from envs.evaluation.driving import drive_recorded, lacks_drive
from envs.evaluation.films import delete_films, make_films
from envs.evaluation.results import write_results
from envs.evaluation.resume import NOTES, note_drives_left_out, note_provenance
from envs.evaluation.suite_drives import with_suite
from envs.evaluation.test_set_errors import errors_on_test_set
from envs.recording.drive_page import drive_path
from envs.recording.results_page import write_results_page
from envs.world.loaded_methods import loaded_method
from envs.world.perception import perception_digest
from envs.world.vehicle import chosen_dynamics
from m3depth.runtimes.choice import recorded_runtime
from marssim.base.bags.library import check_installed
from marssim.base.command.progress import progress
from marssim.base.command.run import run_command
from marssim.base.command.wording import counted
from marssim.base.compute.workers import run_tasks
from marssim.base.files.atomic import write_atomically
from marssim.base.files.json_file import write_json
from marssim.base.results.claim import PARTIAL, ResultFolder


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
        missing = [task for task in config.tasks if not (folder / task.file).is_file() or lacks_drive(config, task)]
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
    make_films(config, tasks, records, provenance)
    write_results_page(config.out, content, records, [task.file for task in tasks])  # again, with the films
    write_bags(config, tasks, records, provenance)
    return content


def _run(config: EvaluateConfig, tasks: list[Task], provenance: Mapping[str, Any]) -> None:
    with progress(len(tasks), "episode", "drive") as bar:

        def finished(arguments: Sequence[Any], driven: tuple[EpisodeRecord, bytes | None]) -> None:
            (record, data), task = driven, arguments[1]
            path, recorded = config.out / "episodes" / task.file, drive_path(config.out, task.file)
            if not holds_drive(path, record):
                delete_films(config.out, task)  # of an earlier drive
                delete_bag(config.out, task)
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
    sys.exit(main())
