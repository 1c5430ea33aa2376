"""Speed is printed, never asserted: `make bench`."""

import os
from collections.abc import Callable
from time import perf_counter
from typing import Any

import numpy as np
import pytest


@pytest.fixture
def clock(capsys: pytest.CaptureFixture[str]) -> Callable[..., float]:
    """clock(name, function, runs) calls the function once to warm up and then `runs` times, and prints the median."""

    def measure(name: str, function: Callable[[], Any], runs: int = 5) -> float:
        function()
        times = []
        for _ in range(runs):
            start = perf_counter()
            function()
            times.append(perf_counter() - start)
        with capsys.disabled():
            threads = os.environ["OMP_NUM_THREADS"]  # tests/conftest.py sets it to 1, `make bench` to all cores
            more = f"(min {min(times) * 1e3:.1f}, {runs} runs, OMP_NUM_THREADS={threads})"
            print(f"\n{name:<58} {np.median(times) * 1e3:9.1f} ms   {more}", end="")
        return float(np.median(times))

    return measure
