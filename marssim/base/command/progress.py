"""How far a command is: a bar on a terminal; in a file or a pipe, a plain line now and then."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence
from typing import TypeVar

from tqdm import tqdm

Item = TypeVar("Item")
LINE_SECONDS = 20.0  # between lines where stderr is no terminal; what takes less time says nothing there


class ProgressLines:
    """Counts, and says so on stderr every LINE_SECONDS. A context manager with tqdm's `update`."""

    def __init__(self, total: int, unit: str, task: str) -> None:
        self.total, self.unit, self.task = total, unit, task
        self.done, self.said = 0, -1
        self.began = self.last = time.monotonic()

    def __enter__(self) -> ProgressLines:
        return self

    def __exit__(self, *exception: object) -> None:
        if 0 <= self.said < self.done:
            self._say()

    def update(self, number: int = 1) -> None:
        """So many more are done."""
        self.done += number
        if time.monotonic() - self.last >= LINE_SECONDS:
            self._say()

    def _say(self) -> None:
        self.last, self.said = time.monotonic(), self.done
        spent = self.last - self.began
        left = spent * (self.total - self.done) / self.done if self.done else 0.0
        took, ahead = tqdm.format_interval(spent), tqdm.format_interval(left)
        end = f"{took}, {ahead} to go" if self.done < self.total else took
        print(f"{self.task}: {self.done}/{self.total} {self.unit}s, {end}", file=sys.stderr, flush=True)


def progress(total: int, unit: str, task: str) -> tqdm[None] | ProgressLines:
    """To be entered by `with` and told by `update`. unit: in the singular. task: the first word of the line."""
    if sys.stderr.isatty():
        return tqdm(total=total, unit=unit, desc=task)
    return ProgressLines(total, unit, task)


def watched(items: Sequence[Item], unit: str, task: str) -> Iterator[Item]:
    """The items, one after the other, and how far one is among them."""
    with progress(len(items), unit, task) as bar:
        for item in items:
            yield item
            bar.update()
