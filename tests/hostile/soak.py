"""Long runs in one process: memory and file handles over hours, with a verdict on whether they grow.

    python tests/hostile/soak.py generate --out soak/generate --amount 10000     # pairs
    python tests/hostile/soak.py drive --out soak/drive --amount 120             # minutes
    python tests/hostile/soak.py train --out soak/train --amount 120 --data DATA # minutes

The same command continues a run that was stopped, as a further piece. OUT/soak.jsonl gets a line every few seconds:
time since the piece began [s], memory [MB], open files, threads. The verdict is on each piece: the slope of its second
half after Theil and Sen, with its 95 % interval, which is too narrow, since lines that follow each other are not
independent. Growth is a slope whose interval lies above zero, and that amounts to more than MOST_GROWTH over the second
half. So a piece of two hours shows a leak of 20 MB an hour, and one of less than 20 minutes has no verdict. Linux only,
since it reads /proc. The exit code is 1 for growth.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence
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


def generate(out: Path, amount: int, data: Path | None) -> int:
    """Generate pairs, in this process."""
    from marssim.generate import main

    size = ["--rig.width", "128", "--rig.height", "128", "--rig.focal", "149", "--renderer", "embree", "--workers", "1"]
    return main(["--out", str(out / "set"), "--pairs", str(amount), "--views-per-scene", "10", *size])


def drive(out: Path, amount: int, data: Path | None) -> int:
    """Drive course after course for some minutes, in this process, with M3Depth, the navigator and the physics."""
    from envs.drivers.builtin import NavigatorDriver
    from envs.drives.episodes import Cell, run_episode
    from envs.mars_nav import MarsNavEnv

    env, driver = MarsNavEnv("m3depth", "physics", goal_distance=10.0, mast=True), NavigatorDriver()
    until, ends = time.monotonic() + 60 * amount, Counter[str]()
    while time.monotonic() < until:
        ends[run_episode(env, driver, Cell(), 0, ends.total()).outcome] += 1
    env.close()
    print(f"{ends.total()} courses: {dict(ends)}")
    return 0


def train(out: Path, amount: int, data: Path | None) -> int:
    """Train for some minutes more than the pieces before, in this process."""
    from m3depth.train import main
    from m3depth.training.run import saved_progress

    if data is None:
        raise SystemExit("train needs --data")
    minutes = saved_progress(out / "run")[1] / 60 + amount
    sizes = ["--batch", "2", "--crop", "128", "128", "--device", "cpu", "--max-minutes", str(minutes)]
    return main(["--data", str(data), "--out", str(out / "run"), *sizes])


WORK: dict[str, Callable[[Path, int, Path | None], int]] = {"generate": generate, "drive": drive, "train": train}


def main(args: Sequence[str] | None = None) -> int:
    """Do a piece of work and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("work", choices=WORK)
    parser.add_argument("--out", type=Path, required=True, help="folder of the results and of soak.jsonl")
    parser.add_argument("--amount", type=int, required=True, help="pairs in all, or minutes of this piece")
    parser.add_argument("--data", type=Path, help="dataset to train on")
    asked = parser.parse_args(args)
    log = Log(asked.out / "soak.jsonl")
    code = WORK[asked.work](asked.out, asked.amount, asked.data)
    log.end()
    grew, words = verdict(log.rows)
    print(f"{asked.work}, {time.monotonic() - log.began:.0f} s: {words}")
    return code or int(grew)


if __name__ == "__main__":
    sys.exit(main())
