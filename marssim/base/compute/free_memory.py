"""The main memory that a process may still take."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

LIMITS, GROUP = Path("/sys/fs/cgroup"), Path("/proc/self/cgroup")  # of Linux's control groups, version 2
UNKNOWN = 2 << 30  # [bytes] where the system does not report it


def free_memory() -> int:
    """Return the main memory that this process may still take [bytes].

    This is what is free on the machine, or what is left of a smaller limit, as containers and the jobs of a cluster's
    queue have it. It is 2 GB where the system reports neither.
    """
    try:
        free = os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (ValueError, OSError, AttributeError):
        free = UNKNOWN
    return min([free, *_left_of_limits()])


def _left_of_limits() -> Iterator[int]:
    """Yield what is left of each limit of this process's control groups [bytes]."""
    try:
        line = next(line for line in GROUP.read_text(encoding="utf-8").splitlines() if line.startswith("0::"))
    except (OSError, StopIteration):
        return
    group = LIMITS / line.removeprefix("0::").lstrip("/")
    for folder in (group, *group.parents):
        try:
            limit = int((folder / "memory.max").read_text(encoding="ascii"))  # "max" where there is none
            used = int((folder / "memory.current").read_text(encoding="ascii"))
            counts = dict(line.split() for line in (folder / "memory.stat").read_text(encoding="ascii").splitlines())
        except (OSError, ValueError):
            continue
        yield max(0, limit - used + int(counts.get("inactive_file", 0)))  # the page cache, which the system frees
