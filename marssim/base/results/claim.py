"""The protocol by which a command claims, locks, refuses, notes and resumes its result folder.

    folder = ResultFolder(out, "dataset", mark="generate.json", settings={"seed": 1})
    with folder.claim(command="--seed 1") as previous:  # what an earlier run noted, or None
        ...  # write results; no other command writes here now

A command is known by its mark, a file that it writes first: as a rule JSON with the settings on which its results
depend. The same command continues an earlier run that has the same settings, and refuses any other folder in one line
before it writes anything.
"""

from __future__ import annotations

import errno
import os
import re
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from marssim.base.files.atomic import write_atomically
from marssim.base.files.json_file import DatasetError, as_json, read_json, write_json
from marssim.base.results.lock import LOCK, sole_writer
from marssim.base.results.out_folder import check_out

NAMED = 3  # differences that a refusal lists
LONGEST = 60  # letters of a value in a refusal
PARTIAL = ".*.[0-9]*.part"  # files that a killed run has half written, see write_atomically


def _always(folder: Path) -> bool:
    return True


@dataclass(frozen=True)
class ResultFolder:
    """A folder for the results of one command, which --out names."""

    path: Path
    """The folder. It need not exist."""
    thing: str
    """What the command makes, for messages: "dataset"."""
    mark: str | None = None
    """Name of the file by which the command knows its folders; None: it takes any folder that is no dataset."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """What the results depend on, as JSON can hold it; it is written to the mark."""
    mark_text: str | None = None
    """A text that is written to the mark instead, for a command that replaces the results of any settings."""
    notes: tuple[str, ...] = ()
    """Keys of the mark that may differ from run to run."""
    digests: tuple[str, ...] = ()
    """Keys of settings whose values are digests of the data; a refusal says "other data"."""
    flags: bool = True
    """Whether settings bear the names of flags, goal_distance for --goal-distance."""
    shared: bool = False
    """Whether a folder without the mark may hold other files."""
    check_place: Callable[[Path], None] = check_out
    """Raises DatasetError for a place that takes no such results; the default refuses a dataset and what is in one."""
    results_key: str | None = None
    """A key that results.json has if it is this command's; another results.json is refused."""
    partial: tuple[str, ...] = (PARTIAL,)
    """Patterns of what a killed run has half written; it is removed."""
    has_results: Callable[[Path], bool] = _always
    """Whether a folder holds results. A mark without results binds nobody: other settings replace it."""

    @property
    def mark_path(self) -> Path:
        """The file with the settings."""
        assert self.mark is not None
        return self.path / self.mark

    @property
    def is_begun(self) -> bool:
        """Whether an earlier run of the command, with any settings, has left results."""
        return self.mark is not None and self.mark_path.is_file() and self.has_results(self.path)

    def check(self) -> dict[str, Any] | None:
        """Check that the command may write to the folder, and write nothing.

        Returns:
            What the run that this one continues noted in the mark; None if there is no such run.

        Raises:
            DatasetError: The folder is a file, a dataset or inside one, holds other files, results of another command
                or results of other settings. One line that says which.
        """
        self.check_place(self.path)
        self._check_results_key()
        if self.mark is None or not self.path.is_dir():
            return None
        if not self.mark_path.is_file():
            self._check_unmarked()
            return None
        if self.mark_text is not None:
            return {}
        previous = read_json(self.mark_path)
        compared = {key: value for key, value in previous.items() if key not in self.notes}
        other = self._differences(compared)
        if not other:
            return previous if self.has_results(self.path) else None
        if not self.has_results(self.path):
            return None
        raise DatasetError(
            f"{self.mark_path}: the {self.thing} in this folder has other settings ({other}); choose another --out"
        )

    @contextmanager
    def claim(self, **notes: Any) -> Iterator[dict[str, Any] | None]:
        """Hold the folder for as long as the block runs, as its only writer.

        The folder is made and the mark written if need be, and what a killed run has half written is removed. If the
        block fails before it writes to a folder that was made here, the folder is removed.

        Args:
            notes: More values for the mark, under keys of `notes`; an earlier run's stay until note() replaces them.

        Yields:
            What the run that this one continues noted in the mark; None if there is no such run.

        Raises:
            DatasetError: See check().
            FolderInUse: Another command writes to the folder.
            OSError: The folder cannot be written.
        """
        self.check()
        existed = self.path.is_dir()
        _make_writable(self.path)
        try:
            with sole_writer(self.path):
                previous = self.check()  # another command may have claimed the folder since
                self.clear_partial()
                if previous is None and self.mark is not None:
                    self._write_mark({**as_json(self.settings), **notes})
                yield previous
        except BaseException:
            if not existed:
                with suppress(OSError):  # it is not empty
                    self.path.rmdir()
            raise

    def note(self, **notes: Any) -> None:
        """Replace values in the mark, under keys of `notes`."""
        self._write_mark({**read_json(self.mark_path), **notes})

    def clear_partial(self) -> None:
        """Remove what killed runs have half written."""
        for pattern in self.partial:
            for rest in list(self.path.glob(pattern)):
                if rest.is_dir():
                    shutil.rmtree(rest)
                else:
                    rest.unlink(missing_ok=True)

    def _write_mark(self, content: dict[str, Any]) -> None:
        if self.mark_text is not None:
            write_atomically(self.mark_path, self.mark_text.encode())
        elif not self.mark_path.is_file() or read_json(self.mark_path) != as_json(content):
            write_json(self.mark_path, content)

    def _check_results_key(self) -> None:
        results = self.path / "results.json"
        if self.results_key is not None and results.is_file() and self.results_key not in read_json(results):
            raise DatasetError(
                f"--out {self.path}: its results.json is of another command or an earlier version; choose another"
            )

    def _check_unmarked(self) -> None:
        """Raise DatasetError if a folder without the mark holds anything that is not the command's."""
        if self.shared:
            if self.has_results is not _always and self.has_results(self.path):
                raise DatasetError(
                    f"{self.mark_path}: no such file, so the files in this folder are another command's, or nothing "
                    f"says how the {self.thing} was made; choose another --out"
                )
            return
        if any(file.name != LOCK and not file.name.startswith(f".{self.mark}.") for file in self.path.iterdir()):
            raise DatasetError(
                f"--out {self.path}: the folder is not empty and holds no {self.thing} of this command; choose another"
            )

    def _differences(self, previous: Mapping[str, Any]) -> str:
        """What the settings noted in the mark differ in, the first few; empty if they do not."""
        asked = as_json(self.settings)
        digests = [key for key in self.digests if previous.get(key) != asked.get(key)]
        previous, asked = ({k: v for k, v in part.items() if k not in self.digests} for part in (previous, asked))
        lines = differences(as_json(previous), asked, flags=self.flags)
        lines += ["other data"] if digests else []
        more = [f"and {len(lines) - NAMED} more"] if len(lines) > NAMED + 1 else []
        return "; ".join([*lines[: NAMED if more else None], *more])


def differences(previous: Any, asked: Any, flags: bool = False) -> list[str]:
    """Return where two settings differ, as "seed 0, not 1", those of the outer levels first.

    Args:
        previous, asked: Nested dicts and lists of JSON's values. A key that is missing counts as null.
        flags: Write the keys as flags, goal_distance as --goal-distance.
    """
    found = sorted(_differences(previous, asked), key=lambda difference: difference[0].count("."))
    names = (re.sub(r"^[a-z]\w*", lambda key: "--" + key[0].replace("_", "-"), n) if flags else n for n, _, _ in found)
    return [f"{name} {_shortened(was)}, not {_shortened(now)}" for name, (_, was, now) in zip(names, found)]


def _differences(previous: Any, asked: Any, name: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Name, previous value and value asked for."""
    if isinstance(previous, Mapping) and isinstance(asked, Mapping):
        for key in dict.fromkeys((*previous, *asked)):
            yield from _differences(previous.get(key), asked.get(key), f"{name}.{key}" if name else str(key))
    elif isinstance(previous, list) and isinstance(asked, list) and _is_nested(previous, asked):
        for i, (one, other) in enumerate(zip(previous, asked)):
            yield from _differences(one, other, f"{name}[{i}]")
    elif previous != asked:
        yield name, previous, asked


def _is_nested(previous: list[Any], asked: list[Any]) -> bool:
    """Whether two lists of one length hold dicts or lists, whose parts can be compared."""
    return len(previous) == len(asked) and any(isinstance(value, dict | list) for value in (*previous, *asked))


def as_typed(value: Any) -> str:
    """Return a value as it is typed on the command line: null as "none", a list with spaces between its values."""
    if isinstance(value, list | tuple):
        return " ".join(map(as_typed, value))
    return "none" if value is None else str(value)


def _shortened(value: Any) -> str:
    text = as_typed(value)
    return text if len(text) <= LONGEST else f"{text[: LONGEST // 2]}...{text[-LONGEST // 2 :]}"  # of paths, the file


def _make_writable(folder: Path) -> None:
    """Make a folder. Raises OSError that names it, before any work is done, if nothing can be written to it."""
    folder.mkdir(parents=True, exist_ok=True)
    if not os.access(folder, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(folder))
