"""How the threads of OpenMP wait for each other, PyTorch's among them."""

from __future__ import annotations

import os

SETTINGS = ("OMP_WAIT_POLICY", "GOMP_SPINCOUNT", "KMP_BLOCKTIME")  # variables by which a user decides it


def wait_passively() -> None:
    """Let OpenMP's threads sleep while they wait, unless a variable of SETTINGS is in the environment.

    By default they wait in a loop that keeps a core busy. Where cores are shared, the thread that they wait for then
    gets no core, and PyTorch becomes several times slower.

    OpenMP reads the environment when it is loaded, with PyTorch: afterwards the call has no effect. Processes that this
    one starts inherit the setting.
    """
    if not any(name in os.environ for name in SETTINGS):
        os.environ["OMP_WAIT_POLICY"] = "passive"
