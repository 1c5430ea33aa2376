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
MIB = 2**20  # [bytes]
COUNT_ERROR_MIB = 8  # by which the kernel's counts of one moment may differ, since each CPU adds in batches


@dataclass(frozen=True)
class Cost:
    """The cost of one call.

    Attributes:
        seconds: Wall-clock time [s].
        peak_mib: Most memory that the whole process held during the call [MiB]; None where the system does not report
            it (Linux does).
        gpu_mib: Most memory that PyTorch held on the GPU [MiB]; None where nothing has run on one.
    """

    seconds: float
    peak_mib: float | None
    gpu_mib: float | None


def measured(call: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> tuple[T, Cost]:
    """Call a function with these arguments, and return its result and its cost."""
    peak_is_reported = _restart_peak()
    cuda = _cuda()
    if cuda is not None:
        cuda.synchronize()
        cuda.reset_peak_memory_stats()
    start = time.perf_counter()
    result = call(*args, **kwargs)
    if cuda is not None:
        cuda.synchronize()
    seconds = time.perf_counter() - start
    peak = _memory("VmHWM") if peak_is_reported else None
    return result, Cost(seconds, peak, cuda.max_memory_allocated() / MIB if cuda else None)


def _restart_peak() -> bool:
    """Have Linux restart its count of this process's peak memory (man 5 proc, clear_refs).

    Some sandboxes take the request and go on counting: the peak then stays above what the process holds.
    """
    try:
        Path("/proc/self/clear_refs").write_text("5")
    except OSError:
        return False
    peak, held = _memory("VmHWM"), _memory("VmRSS")
    return peak is not None and held is not None and peak - held < COUNT_ERROR_MIB


def _memory(field: str) -> float | None:
    """Return a memory figure of this process, a field of /proc/self/status [MiB]; None where there is none."""
    with suppress(OSError):
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith(f"{field}:"):
                return int(line.split()[1]) / 1024
    return None


def _cuda() -> Any:
    """Return torch.cuda where something has run on a GPU. Asking more would take memory of a GPU that nothing uses."""
    torch = sys.modules.get("torch")
    return torch.cuda if torch is not None and torch.cuda.is_initialized() else None
