"""Signals that end a run in good order."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def stop_on_signal() -> Iterator[list[int]]:
    """The list that is handed out holds the signal's number once SIGTERM or SIGINT has come; a second one ends.

    Outside the main thread, where Python lets nobody handle signals, the list stays empty.
    """
    received: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield received
        return

    def remember(number: int, frame: Any) -> None:
        received.append(number)
        restore(number)

    def restore(number: int) -> None:
        handler = before[number]  # None: one that is not Python's, which cannot be set again from here
        signal.signal(number, signal.SIG_DFL if handler is None else handler)

    before: dict[int, Any] = {n: signal.signal(n, remember) for n in (signal.SIGTERM, signal.SIGINT)}
    try:
        yield received
    finally:
        for number in before:
            restore(number)
