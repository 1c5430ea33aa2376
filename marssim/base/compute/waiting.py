"""How the threads of OpenMP wait for each other, PyTorch's among them."""

from __future__ import annotations

import os
import sys
import warnings

_too_late = False  # whether PyTorch had been imported when wait_briefly was called
ROUNDS = 1000  # of GNU's loop: most waits of a small network end within them
SETTINGS = ("OMP_WAIT_POLICY", "GOMP_SPINCOUNT", "KMP_BLOCKTIME")  # variables by which a user decides it


def wait_briefly() -> None:
    """Let OpenMP's threads sleep if they have to wait long, unless a variable of SETTINGS is in the environment.

    By default they wait in a loop that keeps a core busy. Where cores are shared, the thread that they wait for then
    gets no core, and PyTorch becomes several times slower. If they sleep at once, it is slower where cores are free.
    GNU's OpenMP, which PyTorch has on Linux, takes the number of rounds before they sleep; others let them sleep.

    OpenMP reads the environment when it is loaded, with PyTorch: afterwards the call has no effect. Processes that this
    one starts inherit the setting.
    """
    global _too_late
    if not any(name in os.environ for name in SETTINGS):
        os.environ["OMP_WAIT_POLICY"] = "passive"
        os.environ["GOMP_SPINCOUNT"] = str(ROUNDS)
        _too_late = "torch" in sys.modules


def warn_of_busy_threads() -> None:
    """Warn, once, if PyTorch was imported before wait_briefly was called, and has several threads."""
    global _too_late
    if _too_late and sys.modules["torch"].get_num_threads() > 1:
        _too_late = False
        warnings.warn(
            "torch was imported before m3depth or envs, so its threads keep their cores busy while they wait, which is "
            "slow where other programs use them; import m3depth or envs first, or set OMP_WAIT_POLICY=passive",
            RuntimeWarning,
            stacklevel=3,
        )
