"""Seconds and memory of a call."""

import sys
import time

import numpy as np
import pytest
import torch

from m3depth.evaluation.cost import measured


def test_a_call_is_timed_and_its_result_comes_back():
    def work(a, b=1):
        time.sleep(0.02)
        return a + b

    result, cost = measured(work, 2, b=5)
    assert result == 7 and cost.seconds >= 0.02
    assert (cost.gpu_mib is None) == (not torch.cuda.is_initialized())


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only Linux tells")
def test_the_peak_is_that_of_the_call_alone():
    """The first call holds 200 MiB, the second one 20 MiB: the second peak is lower."""
    peaks = [measured(lambda size=size: np.ones(size * 2**17).sum())[1].peak_mib for size in (200, 20)]
    if None in peaks:
        pytest.skip("the kernel cannot restart the count of the peak")
    assert peaks[0] - peaks[1] > 100


def test_a_gpu_that_nothing_uses_is_left_alone(monkeypatch):
    """Where it is full, each question to it fails; --device cpu is then the way out."""

    def full(*_):
        raise RuntimeError("CUDA error: out of memory")

    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    for name in ("synchronize", "reset_peak_memory_stats"):
        monkeypatch.setattr(torch.cuda, name, full)
    assert measured(lambda: 3)[1].gpu_mib is None
    monkeypatch.setattr(torch.cuda, "is_initialized", lambda: True)
    with pytest.raises(RuntimeError, match="out of memory"):
        measured(lambda: 3)


def test_errors_pass_through():
    with pytest.raises(ZeroDivisionError):
        measured(lambda: 1 / 0)
