"""Claim a folder for the results of a command: check it, lock it, record the settings, and resume an earlier run.

    folder = ResultFolder(out, "dataset", mark="generate.json", settings={"seed": 1})
    with folder.claim(command="--seed 1") as previous:  # the mark of an earlier run, or None
        ...  # write results; no other command writes here now

A command marks its folder with a file that it writes first, usually JSON with the settings on which the results
depend. It continues an earlier run with the same settings. It refuses any other folder, in one line, before it writes
anything.
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

from marssim.base.files.atomic import WINDOWS, write_atomically
from marssim.base.files.json_file import DatasetError, as_json, read_json, write_json
from marssim.base.results.lock import LOCK, sole_writer
from marssim.base.results.out_folder import check_out

MOST_DIFFERENCES = 3  # differences of settings that a message lists
LONGEST = 60  # characters of a value in a message
PARTIAL = ".*.[0-9]*.part"  # half-written files of a killed run, see write_atomically


def _always(folder: Path) -> bool:
    return True


def _delete_unused(folder: Path) -> None:
    """Delete a folder, but not one in which a worker of a stopped command on a cluster is still writing."""
    try:
        shutil.rmtree(folder)
    except OSError as error:
        if error.errno not in (errno.ENOENT, errno.ENOTEMPTY, errno.EACCES if WINDOWS else None):
            raise


@dataclass(frozen=True)
class ResultFolder:
    """A folder for the results of one command, which --out names."""

    path: Path
    """The folder. It need not exist."""
    thing: str
    """What the command makes, for messages: "dataset"."""
    mark: str | None = None
    """Name of the file that marks a folder of the command; None takes any folder that is no dataset."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Settings on which the results depend, as values for JSON. They are written to the mark."""
    mark_text: str | None = None
    """Text of the mark instead of settings, for a command that replaces the results of an earlier run."""
    notes: tuple[str, ...] = ()
    """Keys of the mark that may differ from run to run."""
    digests: tuple[str, ...] = ()
    """Keys of settings whose values are digests of data; a message names none of them, but says "other data"."""
    flags: bool = True
    """Whether settings have the names of flags, as goal_distance for --goal-distance."""
    shared: bool = False
    """Whether a folder without the mark may hold other files."""
    check_place: Callable[[Path], None] = check_out
    """Raises DatasetError for a folder that must not take such results; by default, a dataset or a folder in one."""
    results_key: str | None = None
    """A key that the command writes to results.json. A results.json without it is refused."""
    partial: tuple[str, ...] = (PARTIAL,)
    """Glob patterns of files and folders that a killed run has half written. They are deleted. A link in place of a
    folder in which they may lie is refused."""
    has_results: Callable[[Path], bool] = _always
    """Returns whether a folder holds results. A mark without results does not bind: other settings replace it."""

    @property
    def mark_path(self) -> Path:
        """Path of the mark."""
        assert self.mark is not None
        return self.path / self.mark

    @property
    def is_begun(self) -> bool:
        """Whether an earlier run of the command, with any settings, has left results."""
        return self.mark is not None and self.mark_path.is_file() and self.has_results(self.path)

    def check(self) -> dict[str, Any] | None:
        """Check that the command may write to the folder, and write nothing.

        Returns:
            Content of the mark of the run that this one continues; None if there is no such run.

        Raises:
            DatasetError: The folder is a file, a dataset or inside one, or holds other files, results of another
                command or results of other settings. One line that says which.
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
        """Be the only writer of the folder for as long as the block runs.

        The folder is made and the mark written if need be, and files that a killed run has half written are deleted. A
        folder that was made here is deleted again if the block fails before it writes anything.

        Args:
            notes: More values for the mark, under keys of `notes`. Those of an earlier run stay until note() replaces
                them.

        Yields:
            Content of the mark of the run that this one continues; None if there is no such run.

        Raises:
            DatasetError: See check(); or a folder in it is a link, through which results would get elsewhere.
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
                with suppress(OSError):  # the folder is not empty
                    self.path.rmdir()
            raise

    def note(self, **notes: Any) -> None:
        """Replace values in the mark, under keys of the field `notes`."""
        self._write_mark({**read_json(self.mark_path), **notes})

    def clear_partial(self) -> None:
        """Delete files and folders that killed runs have half written.

        Raises:
            DatasetError: A folder in which they may lie is a link.
        """
        for pattern in self.partial:
            for path in list(_matches(self.path, pattern)):
                if path.is_dir() and not path.is_symlink():
                    _delete_unused(path)
                else:
                    path.unlink(missing_ok=True)

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
        """Raise DatasetError if a folder without the mark holds files that may not be the command's."""
        if self.shared:
            if self.has_results is not _always and self.has_results(self.path):
                raise DatasetError(
                    f"{self.mark_path}: no such file, so another command wrote the files in this folder, or nothing "
                    f"records how the {self.thing} was made; choose another --out"
                )
            return
        if any(file.name != LOCK and not file.name.startswith(f".{self.mark}.") for file in self.path.iterdir()):
            raise DatasetError(
                f"--out {self.path}: the folder is not empty and holds no {self.thing} of this command; choose another"
            )

    def _differences(self, previous: Mapping[str, Any]) -> str:
        """Return a text on the first differences between the settings and those of the mark; empty if there is none."""
        asked = as_json(self.settings)
        digests = [key for key in self.digests if previous.get(key) != asked.get(key)]
        previous, asked = ({k: v for k, v in part.items() if k not in self.digests} for part in (previous, asked))
        lines = differences(as_json(previous), asked, flags=self.flags)
        lines += ["other data"] if digests else []
        more = [f"and {len(lines) - MOST_DIFFERENCES} more"] if len(lines) > MOST_DIFFERENCES + 1 else []
        return "; ".join([*lines[: MOST_DIFFERENCES if more else None], *more])


def differences(previous: Any, asked: Any, flags: bool = False) -> list[str]:
    """Return the differences of two settings, as "seed 0, not 1", those of the outer levels first.

    Args:
        previous: Nested dicts and lists of JSON's values. A missing key counts as null.
        asked: The same of the present run.
        flags: Write the keys as flags, goal_distance as --goal-distance.
    """
    lines = []
    for name, before, now in sorted(_differences(previous, asked), key=lambda difference: difference[0].count(".")):
        label = re.sub(r"^[a-z]\w*", lambda key: "--" + key[0].replace("_", "-"), name) if flags else name
        lines.append(f"{label} {_shortened(before)}, not {_shortened(now)}")
    return lines


def _differences(previous: Any, asked: Any, name: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Yield the name, the previous value and the present value of each difference."""
    if isinstance(previous, Mapping) and isinstance(asked, Mapping):
        for key in dict.fromkeys((*previous, *asked)):
            yield from _differences(previous.get(key), asked.get(key), f"{name}.{key}" if name else str(key))
    elif isinstance(previous, list) and isinstance(asked, list) and _is_nested(previous, asked):
        for i, (before, now) in enumerate(zip(previous, asked)):
            yield from _differences(before, now, f"{name}[{i}]")
    elif previous != asked:
        yield name, previous, asked


def _is_nested(previous: list[Any], asked: list[Any]) -> bool:
    """Return whether two lists have the same length and hold dicts or lists, whose parts can be compared."""
    return len(previous) == len(asked) and any(isinstance(value, dict | list) for value in (*previous, *asked))


def as_typed(value: Any) -> str:
    """Return a value as it is typed on the command line, a list with spaces between its values.

    Null, which stands for a flag that is not given, is "none".
    """
    if isinstance(value, list | tuple):
        return " ".join(map(as_typed, value))
    return "none" if value is None else str(value)


def _shortened(value: Any) -> str:
    text = as_typed(value)
    return text if len(text) <= LONGEST else f"{text[: LONGEST // 2]}...{text[-LONGEST // 2 :]}"


def _matches(folder: Path, pattern: str) -> Iterator[Path]:
    """Yield what matches a glob pattern. Raises DatasetError if a folder on the way is a link."""
    first, _, rest = pattern.partition("/")
    if not rest:
        yield from folder.glob(first)
    elif first == "**":
        for root, names, _ in os.walk(folder):
            for name in names:
                _refuse_link(Path(root, name))
            yield from Path(root).glob(rest)
    else:
        for path in folder.glob(first):
            if path.is_dir():
                _refuse_link(path)
                yield from _matches(path, rest)


def _refuse_link(path: Path) -> None:
    if path.is_symlink():
        raise DatasetError(
            f"{path}: is a link, through which nothing is written or deleted; put the folder that it leads to in its "
            "place, or move it elsewhere"
        )


def _make_writable(folder: Path) -> None:
    """Make a folder. Raises OSError, which names it, if it cannot be made or nothing can be written to it."""
    folder.mkdir(parents=True, exist_ok=True)
    if not os.access(folder, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(folder))
