"""Look at the drives of an evaluation in 3-D, in the browser.

    python -m envs.evaluate --perception m3depth sgbm --episodes 10 --out out/eval
    python -m envs.inspect out/eval

The page has a shot for each course: the ground, the rocks that block, the goal, the shortest passable path, and the way
of every driver and perception in the colour of its outcome, with the rover's footprint at its end. Drives that
envs.evaluate recorded (--record) have a shot for each look too: the cloud that the rover saw, the navigator's map, its
planned path, and the motion that it chose. It needs the extra `view`.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from envs.drives.episodes import EpisodeRecord
from envs.drives.records import read_record
from envs.drives.shots import course_shots
from envs.recording.drive_page import drive_path
from envs.recording.look_shots import look_shots
from marssim.base.command.run import run_command
from marssim.base.command.wording import STARTS_OVER
from marssim.base.files.json_file import DatasetError
from marssim.base.view.scene import Shot
from marssim.base.view.show import check_viewer, show


@dataclass(frozen=True)
class InspectConfig:
    """Look at the drives of an evaluation in 3-D, in the browser."""

    run: Annotated[Path, tyro.conf.Positional]
    """Folder of envs.evaluate. Its drives may still be going on."""
    outcome: str | None = None
    """Only show courses on which a drive ended this way, such as collision, stuck or no_path."""


def read_drives(config: InspectConfig) -> dict[Path, EpisodeRecord]:
    """Return the records of the drives that the flags name, by their files.

    Raises:
        DatasetError: The folder holds no drives, or a record is broken; the message names the file.
        ValueError: No drive ended as --outcome says.
    """
    if config.run.is_file():
        raise DatasetError(f"{config.run}: is a file; give the folder that envs.evaluate wrote")
    files = sorted((config.run / "episodes").glob("*.json"))
    if not files:
        raise DatasetError(f"{config.run}: holds no episodes; give a folder that envs.evaluate wrote")
    records = {file: read_record(file) for file in files}
    if config.outcome is None:
        return records
    courses = {_course(record) for record in records.values() if record.outcome == config.outcome}
    if not courses:
        outcomes = ", ".join(sorted({record.outcome for record in records.values()}))
        raise ValueError(f"--outcome {config.outcome}: no drive ended so; they ended as {outcomes}")
    return {file: record for file, record in records.items() if _course(record) in courses}


def inspect_shots(run: Path, records: Mapping[Path, EpisodeRecord]) -> list[Shot]:
    """Return the shots of a page: each course with all its drives, then the looks of those that were recorded.

    It warns of recorded drives whose files are broken, and leaves their looks out.

    Args:
        run: Folder of envs.evaluate.
        records: The records of its drives, by their files.
    """
    courses: dict[tuple[str, int], dict[Path, EpisodeRecord]] = {}
    for file, record in records.items():
        courses.setdefault(_course(record), {})[file] = record
    shots = []
    for _, drives in sorted(courses.items()):
        shots += course_shots(list(drives.values()))
        for file, record in drives.items():
            recorded = drive_path(run, file.name)
            if recorded.is_file():
                try:
                    shots += look_shots(record, recorded)
                except DatasetError as error:
                    print(f"warning: {error}", file=sys.stderr)
    return shots


def _course(record: EpisodeRecord) -> tuple[str, int]:
    return record.cell, record.episode


def main(args: Sequence[str] | None = None) -> int:
    """Run the command and return the exit code."""
    return run_command(_work, InspectConfig, "python -m envs.inspect", __doc__, args, STARTS_OVER)


def _work(config: InspectConfig) -> None:
    check_viewer()
    show(inspect_shots(config.run, read_drives(config)), config.run.resolve().name)


if __name__ == "__main__":
    sys.exit(main())
