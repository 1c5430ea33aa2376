"""What must come of any attack: the work is done, or one line on stderr says what is wrong. Cases are counted."""

from __future__ import annotations

import faulthandler
import os
import random
import signal
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, seed, settings

from marssim.base.command.run import exit_code

CASES = int(os.environ.get("HOSTILE_CASES", "6"))  # of each kind of attack; `make hostile` asks for more
SAME = "HOSTILE_CASES" not in os.environ  # the few of `make test` are the same in each run
MINUTES = float(os.environ.get("HOSTILE_MINUTES", "30"))  # for all
SEED = int(os.environ.get("HOSTILE_SEED", "0"))  # of everything that is random
IN_PROCESSES = 50 * CASES // 300  # cases of a kind of attack whose cases are processes
COUNTS: Counter[tuple[str, str]] = Counter()  # cases of this process by what is attacked and kind of attack

only_in_make_hostile = pytest.mark.skipif(SAME, reason="takes minutes: `make hostile` runs it")


def many(test: Callable[..., object]) -> Callable[..., object]:
    """Let hypothesis try CASES cases of a test, the same for the same SEED."""
    checks = [HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
    return seed(SEED)(settings(max_examples=CASES, database=None, deadline=None, suppress_health_check=checks)(test))


def rng_of(name: str) -> random.Random:
    """Return the random numbers of a test."""
    return random.Random(f"{SEED} {name}")


def count(attacked: str, kind: str) -> None:
    """Count a case."""
    COUNTS[attacked, kind] += 1


def cases(share: float, number: int = IN_PROCESSES) -> Iterator[int]:
    """Yield the numbers of cases, until there are enough or their time is over.

    Args:
        share: Part of MINUTES that they may take.
        number: How many they are.
    """
    until = time.monotonic() + 60 * MINUTES * share
    for case in range(number):
        if time.monotonic() > until:
            return
        yield case


class Harm:
    """Leaves a file when it is unpickled."""

    def __init__(self, file: Path) -> None:
        self.file = file

    def __reduce__(self) -> tuple[Any, ...]:
        return open, (str(self.file), "w")


PATIENCE = 20  # [s] for a case in the process of the test, which takes milliseconds; beside other work more
HUNG = 120  # [s] after which a case that no signal ends takes its process along, and says where it hung


@contextmanager
def in_time() -> Iterator[None]:
    """Let what takes longer than PATIENCE fail."""

    def too_long(*_: object) -> None:
        raise AssertionError(f"not done after {PATIENCE} s")

    before = signal.signal(signal.SIGALRM, too_long)
    signal.setitimer(signal.ITIMER_REAL, PATIENCE)
    faulthandler.dump_traceback_later(HUNG, exit=True, file=sys.__stderr__ or 2)
    try:
        yield
    finally:
        faulthandler.cancel_dump_traceback_later()
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


HARMED = Path(tempfile.gettempdir()) / f"hostile-code-ran-{os.getpid()}"  # appears when a file's code is run
CODE = f"open({str(HARMED)!r}, 'w')".encode()


def judge(work: Callable[[], object], capsys: pytest.CaptureFixture[str], *names: str) -> int:
    """Do the work as a command does it, check what it leaves, and return its exit code.

    Args:
        work: Reads what is hostile.
        capsys: Captures what is printed.
        names: Words of which a refusal must hold one: the attacked flags, or the file.
    """
    capsys.readouterr()
    with warnings.catch_warnings(record=True) as caught, in_time():
        code = exit_code(work)
    assert not caught, f"stderr would show {caught[0].message}"
    error = capsys.readouterr().err
    if HARMED.exists():
        HARMED.unlink()
        raise AssertionError("code from a file was run")
    assert code in (0, 2), error
    if code == 2:
        assert error.startswith("error: ") and error.count("\n") == 1, error
        assert any(name in error for name in names), f"{error}: names none of {names}"
    return code
