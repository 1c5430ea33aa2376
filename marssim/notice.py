"""One line on stderr for who waits at a command where nothing is to be seen: that something takes long, once.

Commands alone speak; a program that calls the package is not spoken into. Of the worker processes that a command starts
the first speaks in its stead, if it has said nothing by then.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Event

_may_speak = Event()


@contextmanager
def speaking() -> Iterator[None]:
    """A command, while it runs: one line may be said."""
    let_speak()
    try:
        yield
    finally:
        _may_speak.clear()


def let_speak() -> None:
    """One line may be said from now on, by this process."""
    _may_speak.set()


def handed_over() -> bool:
    """May the process that is started now speak? This one does so no more."""
    free = _may_speak.is_set()
    _may_speak.clear()
    return free


def say(line: str) -> None:
    """Print the line, if this process may speak and has said nothing yet."""
    if handed_over():
        print(f"note: {line}", file=sys.stderr, flush=True)
