"""Write a file in one step, and name the file in errors of writing."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


def write_atomically(path: Path, data: bytes) -> None:
    """Write a file so that a reader never sees half of it, and a crash leaves the old file or the new one.

    Args:
        path: The file. Its folder is made if need be.
        data: The content.

    Raises:
        OSError: The file cannot be written. The error names it.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with naming(path), part.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Name a path in an OSError of the block that names none. A write to a full disk, for one, does not say where."""
    try:
        yield
    except OSError as error:
        error.filename = error.filename or str(path)
        raise
