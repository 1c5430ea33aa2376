"""Kills at a random time and before a write, a renaming or a deletion (SIGKILL), and inside a write (SIGXFSZ)."""

from __future__ import annotations

import os
import random
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from processes import Ended, Server
from small_runs import SmallRun, results

LONGEST = 1.1  # times the time of an undisturbed run: the latest kill


@dataclass(frozen=True)
class Undisturbed:
    """A run that nothing has killed."""

    results: dict[str, Any]
    seconds: float
    writes: int
    """How often it writes, renames or deletes in its folder."""
    largest: int
    """Size of its largest file [bytes]."""
    total: int
    """Size of all its files [bytes]."""


def undisturbed(server: Server, run: SmallRun, inputs: dict[str, Path], folder: Path) -> Undisturbed:
    """Run a command to its end."""
    out, began = folder / "whole", time.monotonic()
    server.run(run.entry, run.line(out, inputs), out=str(out), writes_file=str(folder / "writes")).check()
    seconds = time.monotonic() - began
    sizes = [path.stat().st_size for path in out.rglob("*") if path.is_file()]
    return Undisturbed(results(run, out), seconds, int((folder / "writes").read_text()), max(sizes), sum(sizes))


Start = Callable[..., tuple[int, Path]]  # starts the command with more keys of a request


def at_a_random_time(rng: random.Random, whole: Undisturbed, start: Start, server: Server) -> Ended:
    """Kill the process, not the workers that it has started."""
    pid, folder = start()
    time.sleep(rng.uniform(0, LONGEST * whole.seconds))
    os.kill(pid, signal.SIGKILL)  # it is still there, since nobody has waited for it
    return server.wait(pid, folder)


def before_a_write(rng: random.Random, whole: Undisturbed, start: Start, server: Server) -> Ended:
    """Let the process kill itself before it opens a file for writing, renames or deletes one."""
    return server.wait(*start(die_at_write=rng.randint(1, whole.writes)))


def inside_a_write(rng: random.Random, whole: Undisturbed, start: Start, server: Server) -> Ended:
    """Let the system kill the process when a file reaches a size."""
    limit = round(whole.largest ** rng.random())
    return server.wait(*start(file_size=limit, file_size_kills=True))


KILLS = {"kill at a random time": at_a_random_time, "kill before a write": before_a_write}
KILLS["kill inside a write"] = inside_a_write
DEATHS = (-signal.SIGKILL, -signal.SIGXFSZ)
