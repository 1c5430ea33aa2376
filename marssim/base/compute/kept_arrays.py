"""Arrays that follow from the sources alone, kept on disk for the next process, beside the compiled kernels."""

from __future__ import annotations

import hashlib
import io
import os
import sys
import zipfile
import zlib
from collections.abc import Callable, Mapping
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import llvmlite.binding
import numpy as np
from numba.core.caching import FunctionCache

from marssim.base.compute.compiled import folder_digest
from marssim.base.files.atomic import write_atomically

STAMP = "stamp"  # the array in a file that says what its others depend on
DISPATCH = ("NPY_DISABLE_CPU_FEATURES", "OPENBLAS_CORETYPE")  # variables that choose the instructions of numpy and BLAS
PACKAGES = ("numpy", "scipy", "numba", "llvmlite", "trimesh")  # which compute the arrays
# zipfile raises RuntimeError where a damaged bit marks a file as encrypted
DAMAGED = (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError)


def kept_arrays(
    owner: Callable[..., object], name: str, make: Callable[[], Mapping[str, np.ndarray]]
) -> Mapping[str, np.ndarray]:
    """Return the arrays of a file, or make them and keep them there.

    The file lies where numba keeps the kernels of the owner's module (NUMBA_CACHE_DIR, the package's own folder, the
    user's). It is made again where any source of the owner's package, the version of a package in PACKAGES or the
    processor differs, or where it is damaged. Where there is no folder to write to, each process makes the arrays.

    Args:
        owner: A function of the module that the arrays belong to.
        name: Name of the file, without its suffix.
        make: Makes the arrays, from constants of the package alone.
    """
    try:
        folder = Path(FunctionCache(owner).cache_path)
    except RuntimeError:  # numba knows no folder that it may write
        return make()
    path, stamp = folder / f"{name}.npz", _stamp(owner)
    with suppress(*DAMAGED), zipfile.ZipFile(path) as archive:  # which checks the CRC of each member
        arrays = {
            member: np.load(io.BytesIO(archive.read(member)), allow_pickle=False) for member in archive.namelist()
        }
        if arrays.pop(STAMP).tobytes() == _with_names(stamp, arrays):  # damage may hide some of them
            return arrays
    arrays = dict(make())
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for member, array in {STAMP: np.frombuffer(_with_names(stamp, arrays), np.uint8), **arrays}.items():
            with archive.open(member, "w") as file:
                np.save(file, array, allow_pickle=False)
    with suppress(OSError):  # a full disk
        write_atomically(path, buffer.getvalue())
    return arrays


def _with_names(stamp: bytes, arrays: Mapping[str, np.ndarray]) -> bytes:
    return stamp + " ".join(sorted(arrays)).encode()


def _version(package: str) -> str:
    """Return the version of a package; empty without its metadata, as in a frozen program."""
    with suppress(PackageNotFoundError):
        return version(package)
    return ""


def _stamp(owner: Callable[..., object]) -> bytes:
    """Return a digest of what the arrays depend on."""
    package = sys.modules[owner.__module__.partition(".")[0]]
    values = [
        *map(_version, PACKAGES), llvmlite.binding.get_host_cpu_name(),
        *(os.environ.get(name, "") for name in DISPATCH),
    ]  # fmt: skip
    return hashlib.sha256(folder_digest(Path(package.__file__ or "").parent) + "\0".join(values).encode()).digest()
