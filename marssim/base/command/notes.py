"""Notes on stderr: lines that begin with "note: " and tell the user of a command what it does without being asked.

`say` is for a step that takes long without showing anything, such as the first compilation. It prints in commands only,
never in a program that imports the package, and at most one line in a command. A command shares this permit with its
worker processes: the first of them that has something to say prints it.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.context import BaseContext
from threading import Semaphore
from typing import Any

_permit: Any = None  # a semaphore of threads or of processes; the process that acquires it may print the line


@contextmanager
def one_note() -> Iterator[None]:
    """Permit one line of `say` while a command runs."""
    use_permit(Semaphore(1))
    try:
        yield
    finally:
        use_permit(None)


def use_permit(permit: Any) -> None:
    """Replace the permit of this process.

    Args:
        permit: A semaphore that this process may share with others; None permits nothing.
    """
    global _permit
    _permit = permit


def permit_for_workers(context: BaseContext) -> Any:
    """Hand the permit of this process over to its worker processes.

    Args:
        context: How the processes are started.

    Returns:
        A semaphore for all of them together; None if this process has no permit or has used it.
    """
    return context.Semaphore(1) if _acquired() else None


def say(line: str) -> None:
    """Print a note if this process has a permit that nobody has used yet."""
    if _acquired():
        print_note(line)


def print_note(line: str) -> None:
    """Print a note, whether or not there is a permit."""
    print(f"note: {line}", file=sys.stderr, flush=True)


def _acquired() -> bool:
    return _permit is not None and bool(_permit.acquire(False))
