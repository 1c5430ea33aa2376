"""One thread: in workers, so that they do not wait for each other's cores, and where the number of cores must not
change results.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import parent_process

import cv2

THREADS = "OMP_NUM_THREADS"  # the variable by which a user decides it


def one_thread_in_workers() -> None:
    """Let OpenCV and PyTorch compute in one thread in a process that multiprocessing started.

    Workers mostly come in groups, and each library takes a thread for each core in each of them. In the main process,
    and where OMP_NUM_THREADS is in the environment, the call does nothing.
    """
    if parent_process() is None or THREADS in os.environ:
        return
    cv2.setNumThreads(1)
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(1)
    else:
        os.environ[THREADS] = "1"  # PyTorch reads it when it is imported


def several_threads() -> bool:
    """Tell whether this process may compute in several threads: neither OpenCV nor OMP_NUM_THREADS is set to one."""
    return cv2.getNumThreads() > 1 and os.environ.get(THREADS) != "1"


@contextmanager
def one_opencv_thread() -> Iterator[None]:
    """Let OpenCV compute in one thread within the block, beside PyTorch's, which would wait for the cores."""
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(before)


@contextmanager
def one_thread() -> Iterator[None]:
    """Let OpenCV and PyTorch, if it is imported, compute in one thread within the block.

    Sums that several threads share differ in their last bits from those of one thread, so a network's depth depends on
    the number of cores, and after some steps of a drive its way does too.
    """
    torch = sys.modules.get("torch")
    of_torch = None if torch is None else torch.get_num_threads()
    with one_opencv_thread():
        if torch is not None:
            torch.set_num_threads(1)
        try:
            yield
        finally:
            if torch is not None:
                torch.set_num_threads(of_torch)
