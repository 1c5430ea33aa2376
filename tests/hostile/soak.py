"""A command in this process, with its memory, open files and threads over hours, and a verdict on whether they grow.

    python tests/hostile/soak.py LOG marssim.generate --out data/soak --pairs 10000 --workers 1
    python tests/hostile/soak.py LOG envs.evaluate --out out/soak --suite marsnav-v1
    python tests/hostile/soak.py LOG m3depth.train --out runs/soak --data DATA --max-minutes 120

The same command continues a run that was stopped, as a further piece. LOG gets a JSON line every few seconds:
time since the piece began [s], memory [MB], open files, threads. The verdict is on each piece: the slope of its second
half after Theil and Sen, with its 95 % interval, which is too narrow, since lines that follow each other are not
independent. Growth is a slope whose interval lies above zero, and that amounts to more than MOST_GROWTH over the second
half. So a piece of two hours shows a leak of 20 MB an hour, and one of less than 20 minutes has no verdict. Only this
process is measured, so take one worker. Linux only, since it reads /proc. The exit code is that of the command, or 1
for growth.
"""

from __future__ import annotations

import argparse
import json
import os
import runpy
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.stats import theilslopes

EVERY = 5.0  # [s] between two lines
FEWEST = 120  # lines in the second half of a piece that a verdict needs; the first minutes and the end take memory too
MOST_GROWTH = {"memory": 20.0, "files": 5.0, "threads": 3.0}  # [MB] and numbers, over the second half of a piece
PAGE_MB = os.sysconf("SC_PAGE_SIZE") / 1e6


def held() -> dict[str, float]:
    """Return memory [MB], open files and threads of this process."""
    memory = int(Path("/proc/self/statm").read_text().split()[1]) * PAGE_MB
    counts = {name: len(os.listdir(f"/proc/self/{folder}")) for name, folder in (("files", "fd"), ("threads", "task"))}
    return {"memory": round(memory, 2), **counts}


class Log:
    """Writes what this process holds to a file, every few seconds, from a thread."""

    def __init__(self, file: Path) -> None:
        file.parent.mkdir(parents=True, exist_ok=True)
        self.file, self.began, self.rows = file, time.monotonic(), list[dict[str, float]]()
        self.piece = time.strftime("%Y-%m-%dT%H:%M:%S")
        self.over = threading.Event()
        self.thread = threading.Thread(target=self._run, daemon=True)
        self.thread.start()

    def _run(self) -> None:
        while not self.over.wait(EVERY):
            self.rows.append({"seconds": round(time.monotonic() - self.began, 1), **held()})
            with self.file.open("a", encoding="utf-8") as log:
                log.write(json.dumps({"piece": self.piece, **self.rows[-1]}) + "\n")

    def end(self) -> None:
        """Write no more."""
        self.over.set()
        self.thread.join()


def verdict(rows: Sequence[dict[str, float]]) -> tuple[bool, str]:
    """Return whether something grew over the second half of a piece, and the slopes in words."""
    half = rows[len(rows) // 2 :]
    if len(half) < FEWEST:
        return False, f"too short for a verdict: {len(half)} of {FEWEST} lines"
    hours = np.array([row["seconds"] for row in half]) / 3600
    step = max(1, len(half) // 1000)  # the slope is that of all pairs of lines
    grew, words = False, []
    for name, most in MOST_GROWTH.items():
        slope, _, low, high = theilslopes([row[name] for row in half][::step], hours[::step], 0.95)
        growing = low > 0 and slope * (hours[-1] - hours[0]) > most
        grew |= growing
        unit = " MB" if name == "memory" else ""
        now = half[-1][name]
        words.append(
            f"{name} {'GROWS ' if growing else ''}{slope:+.2f}{unit}/h ({low:+.2f} to {high:+.2f}), now {now:g}"
        )
    return grew, "; ".join(words)


def run(command: str, args: Sequence[str]) -> int:
    """Run a module as `python -m` does, in this process, and return its exit code."""
    sys.argv = [command, *args]
    try:
        runpy.run_module(command, run_name="__main__", alter_sys=True)
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    return 0


def main(args: Sequence[str] | None = None) -> int:
    """Run a command under the log, print the verdict and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("log", type=Path, help="file of JSON lines that gets what the process holds")
    parser.add_argument("command", help="module to run, as marssim.generate")
    parser.add_argument("args", nargs=argparse.REMAINDER, help="the command's own flags")
    asked = parser.parse_args(args)
    log = Log(asked.log)
    code = run(asked.command, asked.args)
    log.end()
    grew, words = verdict(log.rows)
    print(f"{asked.command}, {time.monotonic() - log.began:.0f} s: {words}")
    return code or int(grew)


if __name__ == "__main__":
    sys.exit(main())
