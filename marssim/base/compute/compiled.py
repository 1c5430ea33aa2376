"""Loops over pixels, compiled by numba once and kept on disk for the next process.

numba's own `cache=True` is not enough here. It takes a kept kernel for fresh as long as the kernel's own file is
unchanged, though kernels call others and use constants of other files; and a package folder that cannot be written, or
a full disk, ends the program.
"""

from __future__ import annotations

import hashlib
import pickle
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit
from numba.core.caching import FunctionCache, IndexDataCacheFile, NullCache
from numba.core.registry import CPUDispatcher

from marssim.base.command.notes import say

COMPILING = "compiling the simulator's loops takes some 20 seconds"
KEPT = f"{COMPILING}, this once: they are kept for later runs"
NOT_KEPT = f"{COMPILING} in each process; set NUMBA_CACHE_DIR to a folder that can be written to keep them"


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Decorator of a kernel: compiled at its first call, strict IEEE arithmetic, division by zero as in numpy.

    It releases Python's lock (GIL), so that kernels run side by side in threads.

    The machine code is kept where numba finds a folder to write (NUMBA_CACHE_DIR, the package's own, the user's), for
    as long as no source file of the package changes; where there is none, each process compiles again. A command
    says that it compiles (marssim.base.command.notes).
    """
    return _kept(njit(error_model="numpy", nogil=True)(function), function)


def compiled_in_place(function: Callable[..., Any]) -> Callable[..., Any]:
    """Decorator of a kernel that makes no arrays: as `compiled`, but without reference counts, which cost time."""
    without_counts: Any = {"error_model": "numpy", "nogil": True, "_nrt": False}
    return _kept(njit(**without_counts)(function), function)


def _kept(kernel: Any, function: Callable[..., Any]) -> Any:
    try:
        kernel._cache = _PackageCache(function)
    except RuntimeError:  # numba knows no folder that it may write
        kernel._cache = _NoCache()
    return kernel


def inlined(function: Callable[..., Any]) -> Callable[..., Any]:
    """Decorator of a part of kernels that makes no arrays. LLVM inlines it into each kernel that calls it.

    Python code cannot call it; the plain function is `py_func`. numba's own `inline="always"` copies the part into each
    caller before types are inferred, which takes twice as long to compile. The wrappers through which Python would call
    the part take time too.
    """
    if not isinstance(njit(function), CPUDispatcher):  # NUMBA_DISABLE_JIT: kernels run as plain Python
        return function
    options = {"nopython": True, "boundscheck": None, "error_model": "numpy", "forceinline": True}
    return _Part(
        function, targetoptions={**options, "no_cpython_wrapper": True, "no_cfunc_wrapper": True, "_nrt": False}
    )


class _Part(CPUDispatcher):
    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        raise TypeError(
            f"{self.py_func.__name__} is a part of compiled kernels and cannot be called from Python; "
            f"use {self.py_func.__name__}.py_func, or write a kernel that calls it"
        )


def read_only(array: np.ndarray, dtype: Any = np.float64) -> np.ndarray:
    """Return a contiguous read-only view, or copy, of an array: a kernel compiles once for each type of its arrays.

    Args:
        array: Any array.
        dtype: Type of the result's elements.

    Returns:
        The same values, C-contiguous and not writable.
    """
    view = np.ascontiguousarray(array, dtype=dtype).view()
    view.setflags(write=False)
    return view


class _PackageCache(FunctionCache):
    loaded = False  # this process took a kernel from disk: those that are missing are few

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        package = sys.modules[function.__module__.split(".")[0]]
        # kernels of other packages are built from this one's parts
        stamp = folder_digest(Path(package.__file__ or "").parent) + folder_digest(Path(__file__).parents[2])
        self._cache_file = _KernelFiles(self.cache_path, self._impl.filename_base, stamp)

    def load_overload(self, signature: Any, target: Any) -> Any:
        kernel = super().load_overload(signature, target)
        if kernel is not None:
            _PackageCache.loaded = True
        elif not _PackageCache.loaded:  # the kernel is compiled next
            say(KEPT)
        return kernel

    def save_overload(self, signature: Any, data: Any) -> None:
        try:
            super().save_overload(signature, data)
        except OSError:  # a full disk: what was compiled still runs
            self.disable()


class _KernelFiles(IndexDataCacheFile):
    """Files of a kernel; what cannot be read, cut off or of another version of this package, is compiled again.

    A file ends with its SHA-256: after a power loss it may have its length and lack some of its blocks, and machine
    code with zeros in it crashes.
    """

    def _dump(self, obj: Any) -> bytes:
        data = super()._dump(obj)
        return data + hashlib.sha256(data).digest()

    def _load_data(self, name: str) -> Any:
        data = Path(self._data_path(name)).read_bytes()
        size = len(data) - hashlib.sha256().digest_size
        if hashlib.sha256(data[:size]).digest() != data[size:]:
            raise ValueError("the file is damaged")
        return pickle.loads(data[:size])  # of this user's own folder, which only this class writes to

    def load(self, key: Any) -> Any:
        try:
            return super().load(key)
        except Exception:  # pickle raises nearly anything
            return None

    def _load_index(self) -> Any:
        try:
            return super()._load_index()
        except Exception:
            return {}


class _NoCache(NullCache):
    def load_overload(self, signature: Any, target: Any) -> None:
        say(NOT_KEPT)


@cache
def folder_digest(package: Path) -> bytes:
    """Hash of all source files in a package's folder."""
    digest = hashlib.sha256()
    for file in sorted(package.rglob("*.py")):
        digest.update(f"{file.relative_to(package)}\n".encode())
        digest.update(file.read_bytes())
    return digest.digest()
