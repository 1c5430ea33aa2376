"""PyBullet, imported on demand: it is heavy, prints to stdout from C, and has no wheel on some platforms."""

from __future__ import annotations

import contextlib
import ctypes
import importlib
import os
import sys
from collections.abc import Iterator
from types import ModuleType

# The maintained drop-in fork has wheels for Pythons that the original has none for.
PACKAGE = "pybullet" if sys.version_info < (3, 12) else "pybullet-arm64"


def import_pybullet() -> ModuleType:
    """The `pybullet` module, imported without the banner that its C code prints.

    Raises ImportError, in one line that says what to do, where PyBullet is not installed.
    """
    loaded = sys.modules.get("pybullet")
    if loaded is not None:
        return loaded
    try:
        with quiet():
            return importlib.import_module("pybullet")
    except ImportError as error:
        raise ImportError(
            f"pybullet cannot be imported ({error}): install it with `pip install {PACKAGE}`, or do without it: the "
            "renderers scan and embree and the kinematic dynamics need none"
        ) from None


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Send stdout and stderr to nowhere for a while, C code's too: it passes by Python's sys.stdout and sys.stderr.

    Exceptions still reach the caller.
    """
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            stream.flush()
    with contextlib.ExitStack() as undo:
        sink = os.open(os.devnull, os.O_WRONLY)
        undo.callback(os.close, sink)
        for descriptor in (1, 2):
            try:
                saved = os.dup(descriptor)
            except OSError:  # it is closed: nothing can be printed there
                continue
            undo.callback(os.close, saved)
            undo.callback(os.dup2, saved, descriptor)
            os.dup2(sink, descriptor)
        undo.callback(_flush_c)  # comes first: what C holds back would be printed later
        yield


def _flush_c() -> None:
    with contextlib.suppress(OSError, AttributeError, TypeError):  # there is no such library by that name on Windows
        ctypes.CDLL(None).fflush(None)
