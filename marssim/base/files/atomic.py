"""Write a file in one step, and name the file in errors of writing."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from zlib import crc32

WINDOWS = os.name == "nt"
PATIENCE = 2.0  # [s] for which a file that another program has open for a moment is waited for


def rename(path: Path, target: Path) -> None:
    """Rename a file or a folder; a file that has the new name is replaced.

    Windows refuses it while another program has one of the files open, such as a scanner for viruses or an indexer. It
    is tried again there for PATIENCE.

    Args:
        path: The file or the folder.
        target: Its new name.

    Raises:
        OSError: It cannot be renamed.
    """
    ends = time.monotonic() + PATIENCE
    while True:
        try:
            path.replace(target)
            return
        except PermissionError:
            if not WINDOWS or time.monotonic() > ends:
                raise
        time.sleep(0.05)


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
    part.unlink(missing_ok=True)
    try:
        with naming(path), part.open("xb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        rename(part, path)
    finally:
        part.unlink(missing_ok=True)


@contextmanager
def written_atomically(path: Path) -> Iterator[Path]:
    """Yield another path for a file, which becomes `path` when the block ends; after an exception it is deleted.

    It is for a library that opens a file by its name and writes to it bit by bit, as that of a video. The other path
    has the same name, in a folder that a killed process leaves behind and that ResultFolder then deletes. Other than
    write_atomically, it does not wait for the disk: after a power cut the file may be empty.

    Args:
        path: The file. Its folder must exist.

    Raises:
        OSError: The file cannot be written. The error names it.
    """
    # short, since Windows takes 260 characters in a path, and libraries repeat the name in it
    part = path.with_name(f".{crc32(path.name.encode(errors='surrogateescape')):08x}.{os.getpid()}.part")
    try:
        part.mkdir(exist_ok=True)
    except OSError as error:
        error.filename = str(path)
        raise
    try:
        yield part / path.name
        rename(part / path.name, path)
    finally:
        shutil.rmtree(part, ignore_errors=True)


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Name a path in an OSError of the block that names none. A write to a full disk, for one, does not say where."""
    try:
        yield
    except OSError as error:
        error.filename = error.filename or str(path)
        raise
