"""Read and write .npy files. Reading a file from elsewhere executes nothing, and every fault is a ValueError."""

from __future__ import annotations

import io
import os
from pathlib import Path

import numpy as np
from numpy.lib.format import MAGIC_PREFIX

from marssim.base.files.whole_file import refuse_endless


def read_npy(path: str | os.PathLike[str]) -> np.ndarray:
    """Return the array of a .npy file, mapped into memory and read-only.

    Raises:
        ValueError: The file is broken. One line that says what is wrong, without the file's name.
        OSError: The file cannot be opened, or is a pipe or a device.
    """
    refuse_endless(Path(path))
    with open(path, "rb") as file:
        if file.read(len(MAGIC_PREFIX)) != MAGIC_PREFIX:  # an archive, a pickle or a text
            raise ValueError("it does not begin like one")
    try:
        return np.load(path, mmap_mode="r", allow_pickle=False)  # mapping also checks the size in the header
    except Exception as error:  # a broken header may raise anything in NumPy's reader
        raise ValueError((str(error).splitlines() or [type(error).__name__])[0]) from None


def encode_npy(array: np.ndarray) -> bytes:
    """Return an array as the content of a .npy file."""
    buffer = io.BytesIO()
    np.save(buffer, array, allow_pickle=False)
    return buffer.getvalue()
