"""Loops over pixels, compiled by numba once and kept on disk for the next process.

numba's own `cache=True` is not enough here. It takes a kept kernel for fresh as long as the kernel's own file is
unchanged, though kernels call others and use constants of other files; and a package folder that cannot be written, or
a full disk, ends the program.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from numba import njit
from numba.core.caching import FunctionCache, IndexDataCacheFile, NullCache

from marssim.base.command.notes import say

COMPILING = "compiling the simulator's loops, which may take a minute"
KEPT = f"{COMPILING}; they are kept for the next run"
NOT_KEPT = f"{COMPILING} in each process; with NUMBA_CACHE_DIR, a folder that can be written, they are kept"


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Decorator of a kernel: compiled at its first call, strict IEEE arithmetic, division by zero as in numpy.

    The machine code is kept where numba finds a folder to write (NUMBA_CACHE_DIR, the package's own, the user's), for
    as long as no source file of the package changes; where there is none, each process compiles anew. A command says
    that it has to (marssim.base.command.notes).
    """
    kernel: Any = njit(error_model="numpy")(function)
    try:
        kernel._cache = _PackageCache(function)
    except RuntimeError:  # numba knows no folder that it may write
        kernel._cache = _NoCache()
    return kernel


def inlined(function: Callable[..., Any]) -> Callable[..., Any]:
    """Decorator of a part of kernels, compiled into each that calls it."""
    return njit(error_model="numpy", inline="always")(function)


class _PackageCache(FunctionCache):
    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        package = sys.modules[function.__module__.split(".")[0]]
        stamp = source_digest(Path(package.__file__ or "").parent)
        self._cache_file = IndexDataCacheFile(self.cache_path, self._impl.filename_base, stamp)

    def load_overload(self, signature: Any, target: Any) -> Any:
        kept = super().load_overload(signature, target)
        if kept is None:  # it is compiled next
            say(KEPT)
        return kept

    def save_overload(self, signature: Any, data: Any) -> None:
        try:
            super().save_overload(signature, data)
        except OSError:  # a full disk: what was compiled still runs
            self.disable()


class _NoCache(NullCache):
    def load_overload(self, signature: Any, target: Any) -> None:
        say(NOT_KEPT)


@cache
def source_digest(package: Path) -> bytes:
    """Hash of all source files in a package's folder."""
    digest = hashlib.sha256()
    for file in sorted(package.rglob("*.py")):
        digest.update(f"{file.relative_to(package)}\n".encode())
        digest.update(file.read_bytes())
    return digest.digest()
