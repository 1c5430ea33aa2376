"""One thread in each worker process, so that workers do not wait for each other's cores."""

from __future__ import annotations

import os
import sys
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
