"""Signals that end a run in good order."""

from __future__ import annotations

import math
import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

# A terminal that is closed, or a connection that is lost, sends SIGHUP. Windows has none.
STOPPING = tuple(getattr(signal, name) for name in ("SIGTERM", "SIGINT", "SIGHUP") if hasattr(signal, name))
# [s] in which a signal after the first is taken for a copy of it: a queue signals the launcher and its processes
REPEAT_WITHIN = 1.0


@contextmanager
def stop_on_signal() -> Iterator[list[int]]:
    """Record the first SIGTERM, SIGINT or SIGHUP instead of ending, so that a run can finish its step and save.

    A signal that is ignored when the block begins stays ignored, as SIGINT is in a command that a script started in
    the background. A second signal has its former effect, unless it comes within REPEAT_WITHIN. Under torchrun
    (LOCAL_RANK is set), later signals are ignored, since torchrun repeats its own; it kills processes that have not
    ended after half a minute. Outside the main thread, where Python cannot handle signals, nothing is recorded.

    Yields:
        A list that holds the number of the signal once one has come.
    """
    received: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield received
        return

    patience = math.inf if "LOCAL_RANK" in os.environ else REPEAT_WITHIN
    first = math.inf  # until the first signal has come

    def record(number: int, frame: Any) -> None:
        nonlocal first
        if not received:
            received.append(number)
            first = time.monotonic()
        elif time.monotonic() - first > patience:
            restore(number)
            signal.raise_signal(number)

    def restore(number: int) -> None:
        handler = before[number]  # None for a handler that is not Python's, which cannot be restored from here
        signal.signal(number, signal.SIG_DFL if handler is None else handler)

    before: dict[int, Any] = {n: signal.getsignal(n) for n in STOPPING if signal.getsignal(n) != signal.SIG_IGN}
    for number in before:
        signal.signal(number, record)
    try:
        yield received
    finally:
        for number in before:
            restore(number)
