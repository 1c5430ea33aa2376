"""Make the page of recorded drives: a time line through what the rover saw, weighed and did.

    python -m envs.evaluate --perception sgbm --record failures --out out/eval
    python -m envs.report out/eval
    python -m envs.report out/eval/drives/A.zip out/other/drives/B.zip --out out/pair.html

A page is one HTML file that opens from the disk, asks the network for nothing, and can be sent to a colleague.
envs.evaluate --record writes the pages itself, and links them from OUT/results.html. With a folder, this command writes
them again; with one drive, its page; with two, a page with both side by side, in step by time or by the way driven.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from envs.recording.drive_page import DRIVES, drive_page
from marssim.base.command.run import run_command
from marssim.base.command.wording import counted
from marssim.base.dataset.drive_file import read_drive
from marssim.base.files.atomic import write_atomically
from marssim.base.files.json_file import DatasetError


@dataclass(frozen=True)
class ReportConfig:
    """Make the page of recorded drives."""

    drives: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Folder of an evaluation with recorded drives, or one or two files of drives."""
    out: Path | None = None
    """Page to write. Left out: beside the drive; two drives need it."""

    def __post_init__(self) -> None:
        if not 1 <= len(self.drives) <= 2:
            raise ValueError(f"name a folder, one drive or two, got {len(self.drives)}")
        if len(self.drives) == 2 and self.out is None:
            raise ValueError("two drives need --out, the page to write")


def report(config: ReportConfig) -> list[Path]:
    """Write the pages, and return their paths.

    Raises:
        DatasetError: A drive is missing or broken, or a folder holds none.
        ValueError: A folder is given beside something else.
    """
    first = config.drives[0]
    if not first.is_dir():
        out = config.out or first.with_suffix(".html")
        if out in config.drives:
            raise ValueError(f"--out {out}: is a drive; name another page")
        write_atomically(out, drive_page([read_drive(path) for path in config.drives]))
        return [out]
    if len(config.drives) == 2 or config.out is not None:
        raise ValueError(f"{first}: is a folder, whose pages lie beside its drives; give it alone, without --out")
    files = sorted((first / DRIVES if (first / DRIVES).is_dir() else first).glob("*.zip"))
    if not files:
        raise DatasetError(f"{first}: holds no recorded drives; envs.evaluate --record all records them")
    for path in files:
        write_atomically(path.with_suffix(".html"), drive_page([read_drive(path)]))
    return [path.with_suffix(".html") for path in files]


def main(args: Sequence[str] | None = None) -> int:
    """Run the command and return the exit code."""
    return run_command(_work, ReportConfig, "python -m envs.report", __doc__, args)


def _work(config: ReportConfig) -> None:
    pages = report(config)
    print(pages[0] if len(pages) == 1 else f"{counted(len(pages), 'page')} in {pages[0].parent}")


if __name__ == "__main__":
    sys.exit(main())
