"""What a call costs: seconds and memory."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")
MIB = 2**20


@dataclass(frozen=True)
class Cost:
    """seconds: wall clock. peak_mib: most memory that the process held meanwhile, everything else in it included; None
    where the system does not tell (it does on Linux). gpu_mib: most that PyTorch held on the GPU; None without one."""

    seconds: float
    peak_mib: float | None
    gpu_mib: float | None


def measured(call: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> tuple[T, Cost]:
    """What the call with these arguments returns, and what it cost."""
    told = _restart_peak()
    cuda = _cuda()
    if cuda is not None:
        cuda.synchronize()
        cuda.reset_peak_memory_stats()
    start = time.perf_counter()
    result = call(*args, **kwargs)
    if cuda is not None:
        cuda.synchronize()
    seconds = time.perf_counter() - start
    return result, Cost(seconds, _peak() if told else None, cuda.max_memory_allocated() / MIB if cuda else None)


def _restart_peak() -> bool:
    """Have Linux count the peak of this process's memory anew (man 5 proc, clear_refs)."""
    try:
        Path("/proc/self/clear_refs").write_text("5")
    except OSError:
        return False
    return True


def _peak() -> float | None:
    with suppress(OSError):
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 1024
    return None


def _cuda() -> Any:
    torch = sys.modules.get("torch")  # not imported for this
    return torch.cuda if torch is not None and torch.cuda.is_available() else None
