"""Show the progress of a command on stderr: a bar on a terminal, a line every 20 s in a file or a pipe."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence
from typing import TypeVar

from tqdm import tqdm

Item = TypeVar("Item")
LINE_SECONDS = 20.0  # between two lines; a shorter task prints none


class ProgressLines:
    """Prints the progress to stderr as a line every LINE_SECONDS. It is used in `with`, like tqdm.

    Args:
        total: Number of items.
        unit: What the items are, in the singular.
        task: First word of each line.
    """

    def __init__(self, total: int, unit: str, task: str) -> None:
        self.total, self.unit, self.task = total, unit, task
        self.done, self.printed = 0, -1
        self.began = self.last = time.monotonic()

    def __enter__(self) -> ProgressLines:
        return self

    def __exit__(self, *exception: object) -> None:
        if 0 <= self.printed < self.done:
            self._print()

    def update(self, number: int = 1) -> None:
        """Count items as done.

        Args:
            number: How many more are done.
        """
        self.done += number
        if time.monotonic() - self.last >= LINE_SECONDS:
            self._print()

    def _print(self) -> None:
        self.last, self.printed = time.monotonic(), self.done
        elapsed = self.last - self.began
        remaining = elapsed * (self.total - self.done) / self.done if self.done else 0.0
        times = tqdm.format_interval(elapsed)
        if self.done < self.total:
            times += f", {tqdm.format_interval(remaining)} to go"
        print(f"{self.task}: {self.done}/{self.total} {self.unit}s, {times}", file=sys.stderr, flush=True)


def progress(total: int, unit: str, task: str) -> tqdm[None] | ProgressLines:
    """Return a progress display for `with`, whose `update(number)` counts items as done.

    Args:
        total: Number of items.
        unit: What the items are, in the singular.
        task: First word of the bar or of each line.
    """
    if sys.stderr.isatty():
        return tqdm(total=total, unit=unit, desc=task)
    return ProgressLines(total, unit, task)


def watched(items: Sequence[Item], unit: str, task: str) -> Iterator[Item]:
    """Yield the items, and show the progress over them.

    Args:
        items: The items.
        unit: What the items are, in the singular.
        task: First word of the bar or of each line.
    """
    with progress(len(items), unit, task) as bar:
        for item in items:
            yield item
            bar.update()
