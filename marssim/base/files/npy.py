"""Arrays in NumPy's own files, from whoever wrote them: nothing is executed, and every fault is one error."""

from __future__ import annotations

import io
import os

import numpy as np
from numpy.lib.format import MAGIC_PREFIX


def read_npy(path: str | os.PathLike[str]) -> np.ndarray:
    """The array of a .npy file, mapped into memory, to be read only.

    Raises ValueError of one line that says what is wrong, but not with which file, and OSError if it cannot be opened.
    """
    with open(path, "rb") as file:
        if file.read(len(MAGIC_PREFIX)) != MAGIC_PREFIX:  # an archive, a pickle or a text by that name
            raise ValueError("it does not begin like one")
    try:
        return np.load(path, mmap_mode="r", allow_pickle=False)  # a header that lies about the size is found so
    except Exception as error:  # whatever a broken header makes the reader stumble over
        raise ValueError((str(error).splitlines() or [type(error).__name__])[0]) from None


def encode_npy(array: np.ndarray) -> bytes:
    """The .npy file of an array."""
    buffer = io.BytesIO()
    np.save(buffer, array, allow_pickle=False)
    return buffer.getvalue()
