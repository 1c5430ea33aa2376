"""Make the page of recorded drives: a time line through what the rover saw, weighed and did.

    python -m envs.evaluate --perception sgbm --record failures --out out/eval
    python -m envs.report out/eval
    python -m envs.report out/eval/drives/A.zip out/other/drives/B.zip --out out/pair.html

A page is one HTML file that opens from the disk, asks the network for nothing, and can be sent to a colleague.
envs.evaluate --record writes the pages itself, and links them from OUT/results.html. With a folder, this command writes
them again; with one drive, its page; with two of one course, a page with both side by side, in step by time or by the
way driven.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from envs.recording.drive_page import DRIVES, drive_page, write_drive_pages
from marssim.base.command.run import run_command
from marssim.base.command.wording import STARTS_OVER, counted
from marssim.base.dataset.drive_file import DriveFile, read_drive
from marssim.base.files.atomic import write_atomically
from marssim.base.files.json_file import DatasetError

SAME_COURSE = 0.1  # [m] by which start, goal and shortest path of two drives of one course may differ, as in drive.js


@dataclass(frozen=True)
class ReportConfig:
    """Make the page of recorded drives."""

    drives: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Folder of an evaluation with recorded drives, or one or two files of drives."""
    out: Path | None = None
    """Page to write, with a name that ends in .html. Left out: beside the drive; two drives need it."""

    def __post_init__(self) -> None:
        if not 1 <= len(self.drives) <= 2:
            raise ValueError(f"name a folder, one drive or two, got {len(self.drives)}")
        if len(self.drives) == 2 and self.out is None:
            raise ValueError("two drives need --out, the page to write")


def report(config: ReportConfig) -> list[Path]:
    """Write the pages, and return their paths.

    Raises:
        DatasetError: A drive is missing or broken, or a folder holds none. The pages of all others are written first.
        ValueError: A folder is given beside something else, or two drives are of different courses.
    """
    first = config.drives[0]
    if not first.is_dir():
        out = config.out or first.with_suffix(".html")
        if out.suffix.lower() != ".html":
            raise ValueError(f"--out {out}: must end in .html")
        drives = [read_drive(path) for path in config.drives]
        if difference := _difference_of_courses(drives[0], drives[-1]):
            raise ValueError(f"{first} and {config.drives[-1]} are drives of different courses: {difference}")
        write_atomically(out, drive_page(drives))
        return [out]
    if len(config.drives) == 2 or config.out is not None:
        raise ValueError(f"{first}: is a folder, whose pages lie beside its drives; give it alone, without --out")
    pages, broken = write_drive_pages(first / DRIVES if (first / DRIVES).is_dir() else first, again=True)
    if broken:
        others = f" ({counted(len(broken), 'broken drive')}; {counted(len(pages), 'page')} written)"
        raise DatasetError(f"{broken[0]}{others}")
    if not pages:
        raise DatasetError(f"{first}: holds no recorded drives; envs.evaluate --record all records them")
    return pages


def _difference_of_courses(a: DriveFile, b: DriveFile) -> str | None:
    """Return in what the courses of two drives differ, in words; None if they are of one course."""
    one, other = a.content["episode"], b.content["episode"]
    ways = [np.array(each["shortest_path"], float).reshape(-1, 2) for each in (one, other)]
    if (gap := _distance(one["goal"], other["goal"])) > SAME_COURSE:
        return f"their goals are {gap:.1f} m apart"
    if len(one["obstacles"]) != len(other["obstacles"]):
        return f"they have {len(one['obstacles'])} and {len(other['obstacles'])} rocks that block"
    if not all(map(len, ways)):
        return "only one has a shortest path" if any(map(len, ways)) else None
    if (gap := _distance(ways[0][0], ways[1][0])) > SAME_COURSE:
        return f"their starts are {gap:.1f} m apart"
    lengths = [float(np.hypot(*np.diff(way, axis=0).T).sum()) for way in ways]
    if abs(lengths[0] - lengths[1]) > SAME_COURSE:
        return f"their shortest paths are {lengths[0]:.1f} and {lengths[1]:.1f} m long"
    return None


def _distance(a: Sequence[float] | np.ndarray, b: Sequence[float] | np.ndarray) -> float:
    return float(np.hypot(*np.subtract(a, b)))


def main(args: Sequence[str] | None = None) -> int:
    """Run the command and return the exit code."""
    return run_command(_work, ReportConfig, "python -m envs.report", __doc__, args, STARTS_OVER)


def _work(config: ReportConfig) -> None:
    pages = report(config)
    print(pages[0] if len(pages) == 1 else f"{counted(len(pages), 'page')} in {pages[0].parent}")


if __name__ == "__main__":
    sys.exit(main())
