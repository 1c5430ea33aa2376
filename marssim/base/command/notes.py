"""One line on stderr for who waits at a command where nothing is to be seen: that something takes long, once.

Commands alone speak; a program that calls the package is not spoken into. Of the worker processes that a command starts
the first that has something to say speaks in its stead, if it has said nothing by then.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.context import BaseContext
from threading import Semaphore
from typing import Any

GOES_ON = "the same command goes on from here"
KILLED = f"a worker process was killed, perhaps for lack of memory; {GOES_ON}, with fewer --workers it needs less"

_turn: Any = None  # a semaphore of threads or of processes: whoever acquires it may say the line


@contextmanager
def speaking() -> Iterator[None]:
    """A command, while it runs: one line may be said."""
    take_turn(Semaphore(1))
    try:
        yield
    finally:
        take_turn(None)


def take_turn(turn: Any) -> None:
    """From now on this process may speak when it is given this turn, one for all that have it."""
    global _turn
    _turn = turn


def shared_turn(context: BaseContext) -> Any:
    """The turn for processes that are started in a context, None if the line was said. This one speaks no more."""
    return context.Semaphore(1) if _free() else None


def say(line: str) -> None:
    """Print the line, if this process may speak and neither it nor those that share its turn have said one."""
    if _free():
        print(f"note: {line}", file=sys.stderr, flush=True)


def _free() -> bool:
    return _turn is not None and bool(_turn.acquire(False))


def counted(number: int, noun: str) -> str:
    """ "1 pair", "2 pairs"."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
