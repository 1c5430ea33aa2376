"""Surroundings in which a command must work or refuse: disks, limits, streams, locales, missing folders."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

PAGE = 4096  # [bytes] unit of the size of a disk in memory


@contextmanager
def small_disk(folder: Path, pages: int) -> Iterator[bool]:
    """Mount a disk in memory on a folder while the block runs; yield whether this process may."""
    folder.mkdir()
    size = f"size={pages * PAGE}"
    mounted = shutil.which("mount") is not None and _is_done("mount", "-t", "tmpfs", "-o", size, "tmpfs", str(folder))
    try:
        yield mounted
    finally:
        if mounted:
            subprocess.run(["umount", "-l", str(folder)], check=True)


def make_read_only(folder: Path) -> None:
    """Let nobody write to the disk that is mounted on a folder, root neither."""
    subprocess.run(["mount", "-o", "remount,ro", str(folder)], check=True)


def _is_done(*command: str) -> bool:
    return subprocess.run(command, capture_output=True).returncode == 0


@dataclass(frozen=True)
class Start:
    """How an interpreter starts."""

    shell: str | None = None
    """What a shell does with the command, which is "$@"."""
    variables: dict[str, str | None] = field(default_factory=dict)
    """Variables of the environment that differ; None is one that is missing."""
    may_fail: bool = False
    """Whether the command may report that it could not print everything."""

    def environment(self) -> dict[str, str]:
        """Return the variables."""
        variables = {**os.environ, "OMP_NUM_THREADS": "1", **self.variables}
        return {name: value for name, value in variables.items() if value is not None}


def _locale(**variables: str | None) -> Start:
    return Start(variables={"LC_ALL": None, "LANG": None, "PYTHONIOENCODING": None, "PYTHONUTF8": None, **variables})


NO_HOME = {"HOME": None, "USER": None, "LOGNAME": None, "XDG_CACHE_HOME": None, "XDG_CONFIG_HOME": None}
STARTS = {
    "closed stream": [
        Start('exec "$@" >&-'), Start('exec "$@" 2>&-'), Start('exec "$@" >&- 2>&-'), Start('exec "$@" <&-'),
        Start('exec "$@" <&- >&- 2>&-'), Start('exec "$@" >/dev/full', may_fail=True), Start('exec "$@" 2>/dev/full'),
    ],
    "locale": [
        _locale(LC_ALL="C"), _locale(LC_ALL="C", PYTHONUTF8="0", PYTHONCOERCECLOCALE="0"), _locale(LC_ALL="POSIX"),
        _locale(PYTHONIOENCODING="latin-1"), _locale(PYTHONIOENCODING="ascii"), _locale(LC_ALL="tr_TR.UTF-8"),
        _locale(PYTHONIOENCODING="cp1252"), _locale(LC_ALL="xx_YY.nonsense"), _locale(PYTHONIOENCODING="utf-16"),
    ],
    "no home": [
        Start(variables=NO_HOME), Start(variables={**NO_HOME, "HOME": "/nowhere"}),
        Start(variables={**NO_HOME, "HOME": ""}), Start(variables={**NO_HOME, "HOME": "/proc", "TERM": None}),
        Start(variables={**NO_HOME, "MPLCONFIGDIR": "/proc/none", "HOME": "/dev/null"}),
    ],
}  # fmt: skip
