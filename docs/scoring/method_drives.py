"""Collect drives of several perceptions over the same courses, one JSON line a drive, and compare them by course.

    python docs/scoring/method_drives.py --file out/gale.jsonl --folders out/gale/lite out/gale/sgbm
    python docs/scoring/method_drives.py --file docs/results/methods/gale.jsonl

FOLDERS are those of envs.evaluate, whole or of shards; their drives are added to the file. A drive that the file holds
already is left as it is. The table is printed as Markdown: it has the courses that all perceptions have driven, and
differences to the first of --order. Where the courses are of several k or slopes, each has rows of its own, and the
last rows are of all.
"""

from __future__ import annotations

import json
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np

from envs.drives.episodes import EpisodeRecord
from envs.drives.metrics import paired_difference, summarise
from envs.drives.records import read_record
from marssim.base.command.run import run_command
from marssim.base.files.atomic import write_atomically
from marssim.base.files.json_file import DatasetError

LEFT_OUT = ("obstacles", "track", "headings", "shortest_path", "half", "relief")  # what maps are drawn from


@dataclass(frozen=True)
class Options:
    """Collect drives of several perceptions, and compare them by course."""

    file: Path
    """File of JSON lines, one a drive: its record by envs.evaluate, without what maps are drawn from."""
    folders: tuple[Path, ...] = ()
    """Folders of envs.evaluate, whose drives are added to the file."""
    order: tuple[str, ...] = ("lite", "uni-mvs-net", "raft-stereo", "cre-stereo", "sgbm")
    """Names of the perceptions in the order of the table: names of methods, or of files of weights."""


def name_of(perception: str) -> str:
    """Return the name of a perception: of weights, that of their file without its ending."""
    return Path(perception.removeprefix("m3depth:")).stem


def read_drives(file: Path) -> list[EpisodeRecord]:
    """Return the drives of a file.

    Raises:
        DatasetError: A line is no drive; the message names it.
    """
    known = {field.name for field in fields(EpisodeRecord)}
    drives = []
    for number, line in enumerate(file.read_text().splitlines(), 1):
        try:
            drives.append(EpisodeRecord(**json.loads(line)))
        except (json.JSONDecodeError, TypeError):
            needed = ", ".join(sorted(known - set(LEFT_OUT)))
            raise DatasetError(f"--file {file}: line {number} is no drive, a JSON object with {needed}") from None
    return drives


def collect(file: Path, folders: Sequence[Path]) -> list[EpisodeRecord]:
    """Add the drives of folders to a file, and return all, in the order of perception and course.

    Raises:
        DatasetError: A folder holds no drive, a file cannot be read, or the drives cannot be compared; then the file
            stays as it is.
    """
    drives = {_key(drive): drive for drive in (read_drives(file) if file.exists() else [])}
    for folder in folders:
        files = sorted((folder / "episodes").glob("*.json"))
        if not files:
            raise DatasetError(f"--folders {folder}: holds no drive of envs.evaluate")
        for path in files:
            drive = read_record(path)
            drives.setdefault(_key(drive), drive)
    together = [drives[key] for key in sorted(drives)]
    check_comparable(file, together)
    if folders:
        lines = (json.dumps({k: v for k, v in asdict(d).items() if k not in LEFT_OUT}) for d in together)
        write_atomically(file, "".join(line + "\n" for line in lines).encode())
    return together


def _key(drive: EpisodeRecord) -> tuple[str, str, str, int]:
    return drive.driver, drive.perception, drive.cell, drive.episode


def check_comparable(file: Path, drives: Sequence[EpisodeRecord]) -> None:
    """Raise DatasetError if drives are of several drivers, or of two perceptions with one name (name_of).

    Args:
        file: The file that the drives are for, which the message names.
        drives: The drives.
    """
    if len(drivers := {drive.driver for drive in drives}) > 1:
        raise DatasetError(f"--file {file}: can hold the drives of one driver, not of {', '.join(sorted(drivers))}")
    perceptions: dict[str, str] = {}
    for drive in drives:
        other = perceptions.setdefault(name_of(drive.perception), drive.perception)
        if other != drive.perception:
            raise DatasetError(f"--file {file}: both {other} and {drive.perception} would be {name_of(other)} in it")


def drives_table(drives: Sequence[EpisodeRecord], order: Sequence[str]) -> str:
    """Return a Markdown table of the perceptions over the courses that all have driven.

    Where they are of several cells, each cell has its rows, and "all" has those of all cells. Intervals of "all" take
    the courses of one number in all cells for one (paired_difference).

    Args:
        drives: The drives, which check_comparable has passed.
        order: Names of perceptions (name_of) in the order of the rows; differences are to the first.

    Raises:
        ValueError: A perception is missing, or there is no course that all have driven.
    """
    by_name: dict[str, dict[tuple[str, int], EpisodeRecord]] = {}
    for drive in drives:
        by_name.setdefault(name_of(drive.perception), {})[drive.cell, drive.episode] = drive
    if missing := [name for name in order if name not in by_name]:
        raise ValueError(f"order must name perceptions of the file, {', '.join(by_name)}, got {', '.join(missing)}")
    shared = sorted(set.intersection(*(set(by_name[name]) for name in order)))
    if not shared:
        raise ValueError("order must name perceptions that have driven the same course")
    head = (
        "| perception | goals reached, SPL | what ended the others | Abs Rel on the way | rocks missed [%] | "
        f"success, less `{order[0]}` [points] | SPL, less `{order[0]}` |"
    )
    blocks = {cell: [course for course in shared if course[0] == cell] for cell, _ in shared}
    if len(blocks) == 1:
        lines = [head, "|---|---|---|---|---|---|---|", *_rows(by_name, order, shared)]
    else:
        lines = ["| courses " + head, "|---|---|---|---|---|---|---|---|"]
        for cell, courses in {**blocks, "all": shared}.items():
            lines += [f"| {cell} {row}" for row in _rows(by_name, order, courses)]
    return "\n".join(lines) + "\n"


def _rows(
    by_name: Mapping[str, Mapping[tuple[str, int], EpisodeRecord]],
    order: Sequence[str],
    courses: Sequence[tuple[str, int]],
) -> list[str]:
    """Return the rows of the perceptions over these courses."""
    first = [by_name[order[0]][course] for course in courses]
    lines = []
    for name in order:
        of_method = [by_name[name][course] for course in courses]
        row = summarise(of_method)
        reached = f"{round(row['success_rate'] * len(courses))} of {len(courses)}, {_short(row['spl'])}"
        ended = Counter(drive.outcome.replace("_", " ") for drive in of_method if drive.outcome != "goal")
        others = ", ".join(f"{count} {outcome}" for outcome, count in sorted(ended.items())) or "-"
        error = "-" if row["abs_rel"] is None else f"{row['abs_rel']:.3f}".removeprefix("0")
        rocks = sum(drive.rocks or 0 for drive in of_method)
        missed = f"{100 * sum(drive.rocks_missed or 0 for drive in of_method) / rocks:.1f}" if rocks else "-"
        less = ("-", "-") if name == order[0] else _less(paired_difference(of_method, first))
        lines.append(f"| {name} | {reached} | {others} | {error} | {missed} | {' | '.join(less)} |")
    return lines


def _less(difference: Mapping[str, object]) -> tuple[str, str]:
    """Return a difference of success [percentage points] and one of SPL with their intervals."""
    low, high = 100 * np.array(difference["interval"])
    success = f"{100 * np.float64(difference['difference']):+.0f} ({low:+.0f} to {high:+.0f})"
    spl = _short(difference["spl_difference"], "+")
    if difference["spl_interval"] is not None:
        spl += f" ({' to '.join(_short(end, '+') for end in np.array(difference['spl_interval']))})"
    return success, spl


def _short(value: object, sign: str = "") -> str:
    return f"{np.float64(value):{sign}.2f}".replace("0.", ".")


def work(options: Options) -> None:
    """Collect and print the table."""
    if not options.folders and not options.file.exists():
        raise DatasetError(f"--file {options.file}: there is no such file, and no --folders to make it of")
    print(drives_table(collect(options.file, options.folders), options.order), end="")


def main(args: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    return run_command(work, Options, "python docs/scoring/method_drives.py", __doc__, args)


if __name__ == "__main__":
    sys.exit(main())
