"""PyBullet, imported on demand: it is large, its C code prints to stdout, and some platforms have no wheel."""

from __future__ import annotations

import contextlib
import ctypes
import importlib
import importlib.util
import os
import sys
from collections.abc import Iterator
from types import ModuleType

# The maintained drop-in fork has wheels where the original has none.
PACKAGE = "pybullet" if sys.platform == "linux" and sys.version_info < (3, 12) else "pybullet-arm64"


def import_pybullet() -> ModuleType:
    """Import `pybullet` without the banner that its C code prints, and return the module.

    Raises:
        ImportError: PyBullet is not installed. The message is one line that says what to do.
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


def pybullet_is_installed() -> bool:
    """Return whether PyBullet is installed, without importing it."""
    if "pybullet" in sys.modules:
        return sys.modules["pybullet"] is not None
    return importlib.util.find_spec("pybullet") is not None


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Discard what is printed to stdout and stderr inside the `with` block, by C code too.

    C code bypasses Python's sys.stdout and sys.stderr, so the file descriptors are redirected. Exceptions still reach
    the caller.
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
            except OSError:  # the descriptor is closed: nothing can be printed to it
                continue
            undo.callback(os.close, saved)
            undo.callback(os.dup2, saved, descriptor)
            os.dup2(sink, descriptor)
        undo.callback(_flush_c)  # runs first: C would print its buffer after the block
        yield


def _flush_c() -> None:
    with contextlib.suppress(OSError, AttributeError, TypeError):  # Windows has no library of that name
        ctypes.CDLL(None).fflush(None)
