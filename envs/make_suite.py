"""Make a suite of episodes: draw its courses, and record what identifies each.

    python -m envs.make_suite --name mine-v1 --courses 20 --out mine-v1.json
    python -m envs.make_suite --held-out marsnav-v1 --passphrase-file secret.txt
    python -m envs.make_suite --held-out marsnav-v1 --passphrase-file secret.txt --published DIGEST --out held_out.json

The first command makes a suite with the splits dev and test. The second prints the digest of a passphrase, of the
suite's file and of --courses, to publish before a challenge. The third draws the courses of the held-out split, which
nobody could know before. It refuses a digest of another passphrase, of another file or of another number of courses.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from envs.suites.conditions import CONDITIONS, condition_values
from envs.suites.held_out import SHORTEST, SPLIT, held_out_seed, published_digest
from envs.suites.making import SEEDS, make_suite, suite_conditions, suite_text
from envs.suites.suite import load_suite, packaged_suites, suite_schema
from marssim.base.command.limits import check_least
from marssim.base.command.progress import progress
from marssim.base.command.run import run_command
from marssim.base.command.wording import STARTS_OVER
from marssim.base.files.atomic import write_atomically
from marssim.base.files.json_schema import first_fault


@dataclass(frozen=True)
class MakeSuiteConfig:
    """Draw the courses of a suite and write them to a file."""

    out: Path | None = None
    """JSON file of the suite. A file that exists is not replaced."""
    name: str | None = None
    """Name of the new suite, with its version: letters, digits, _, . and -. Not that of a suite in the package, which
    does not change."""
    courses: int = 20
    """Number of courses in each split and condition, 1 or more."""
    condition: tuple[str, ...] = ()
    """Conditions of the new suite; without any, all that the package has."""
    held_out: str | None = None
    """Suite, by name or file, whose conditions a held-out split takes over. Needs --passphrase-file."""
    passphrase_file: Path | None = None
    """Text file with the passphrase that the held-out courses follow from. Without --published, the command prints the
    digest of passphrase, suite and --courses, which is to be published first, and draws nothing."""
    published: str | None = None
    """The digest that was published. Passphrase, suite and --courses must be those of the digest."""

    def __post_init__(self) -> None:
        check_least(self, courses=1)
        if fault := self.name and first_fault(self.name, suite_schema()["properties"]["suite"], "--name"):
            raise ValueError(fault)
        if self.name in packaged_suites():
            raise ValueError(f"--name {self.name}: the package has a suite of this name; choose another")
        for name in self.condition:
            condition_values(name)  # raises ValueError for an unknown name
        if (self.held_out is None) != (self.passphrase_file is None):
            raise ValueError("--held-out and --passphrase-file need each other")
        if self.published is not None and self.held_out is None:
            raise ValueError("--published needs --held-out")
        if self.held_out is not None and (self.name is not None or self.condition):
            given = "--condition" if self.name is None else "--name"
            raise ValueError(f"{given} is for a new suite: that of --held-out has its own name and conditions")
        if self.out is None and (self.held_out is None or self.published is not None):
            raise ValueError("--out must name the file of the suite")
        if self.out is not None and self.out.suffix != ".json":
            raise ValueError(f"--out {self.out}: the file of a suite must end in .json")
        if self.out is not None and self.held_out is not None and self.published is None:
            raise ValueError("--out needs --published: without it, the command prints the digest, and writes no file")
        if not self.name and self.held_out is None:
            raise ValueError("--name must name the new suite, with its version")


def write_suite(config: MakeSuiteConfig) -> Path:
    """Draw a suite and write its file.

    Returns:
        The file.

    Raises:
        DatasetError: The suite of --held-out cannot be read.
        ValueError: The file exists, or cannot be written; or passphrase, suite and number of courses are not those of
            the digest.
    """
    assert config.out is not None
    if config.out.exists():
        raise ValueError(f"--out {config.out}: exists; a suite that others may have driven does not change")
    try:
        config.out.parent.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        raise ValueError(f"--out {config.out}: there is a file in the place of its folder") from None
    if not os.access(config.out.parent, os.W_OK):
        raise ValueError(f"--out {config.out}: its folder cannot be written to")
    splits: dict[str, dict[str, int]]
    drive: dict[str, Any] = {}
    if config.held_out is None:
        name = config.name or ""  # which __post_init__ asks for
        splits = {split: {"seed": seed, "courses": config.courses} for split, seed in SEEDS.items()}
        chosen = config.condition or CONDITIONS
        conditions = {key: values for key, values in suite_conditions().items() if key in chosen}
    else:
        suite = load_suite(config.held_out, "held_out")
        seed = held_out_seed(suite, config.courses, _passphrase(config), config.published or "")
        name, splits = f"{suite.name}-held-out", {SPLIT: {"seed": seed, "courses": config.courses}}
        conditions, drive = dict(suite.conditions), {"drive": suite.drive}
    number = config.courses * len(splits) * len(conditions)
    with progress(number, "course", "draw") as bar:
        content = make_suite(name, splits, conditions, **drive, advance=bar.update)
    write_atomically(config.out, suite_text(content).encode())
    return config.out


def _passphrase(config: MakeSuiteConfig) -> str:
    file = config.passphrase_file
    assert file is not None
    try:
        passphrase = file.read_text(encoding="utf-8-sig").strip()  # some editors put a mark first
    except UnicodeDecodeError:
        raise ValueError(f"--passphrase-file {file}: is no text in UTF-8") from None
    if (length := len(passphrase)) < SHORTEST:
        raise ValueError(f"--passphrase-file {file}: must hold {SHORTEST} characters or more, got {length}")
    return passphrase


def main(args: Sequence[str] | None = None) -> int:
    """Run the command and return the exit code."""
    return run_command(_work, MakeSuiteConfig, "python -m envs.make_suite", __doc__, args, STARTS_OVER)


def _work(config: MakeSuiteConfig) -> None:
    if config.held_out is not None and config.published is None:
        print(published_digest(load_suite(config.held_out, "held_out"), config.courses, _passphrase(config)))
        return
    file = write_suite(config)
    suite = load_suite(str(file))
    print(f"{len(suite.episodes)} episodes in {file}, SHA-256 {suite.sha256}")


if __name__ == "__main__":
    sys.exit(main())
