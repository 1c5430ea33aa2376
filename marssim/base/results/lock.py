"""One command at a time writes to a folder."""

from __future__ import annotations

import errno
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

LOCK = ".lock"
TAKEN = (errno.EAGAIN, errno.EACCES)


class FolderInUse(ValueError):
    """Another command writes to the folder; the message names both."""


@contextmanager
def sole_writer(folder: Path) -> Iterator[None]:
    """Hold a folder, which is made if need be, for as long as the block runs. Raises FolderInUse, OSError.

    The lock is the operating system's (flock) on the file .lock: it ends with the process, also by kill -9, so that
    none is ever left over; the file goes when the block ends, and one that a killed command leaves locks nothing.
    Over NFS, Linux hands it on to the server, so that it holds between machines too. Where the system or the file
    system knows no such lock (Windows, some network disks), nothing is held.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / LOCK
    file = _take(path, folder)
    try:
        with suppress(OSError):  # who it is is a courtesy: a full disk does not end the command here
            os.truncate(file, 0)
            os.write(file, f"process {os.getpid()} on {socket.gethostname()}".encode())
        yield
    finally:
        path.unlink(missing_ok=True)  # while it is held: whoever has opened it sees that it is gone, and looks again
        os.close(file)


def check_unused(folder: Path) -> None:
    """Raise FolderInUse if a command writes to the folder now; nothing is held, and nothing is written.

    A lock file that a killed command has left says nothing, nor does one that cannot be read.
    """
    with suppress(OSError):
        file = os.open(folder / LOCK, os.O_RDONLY)
        try:
            if fcntl is not None:
                fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno in TAKEN:
                raise FolderInUse(_in_use(folder, file)) from None
        finally:
            os.close(file)


def _in_use(folder: Path, file: int) -> str:
    who = os.read(file, 200).decode(errors="replace")
    return f"{folder}: another command{f' ({who})' if who else ''} is writing here; let it end first"


def _take(path: Path, folder: Path) -> int:
    """File descriptor of the lock file, locked."""
    while True:
        file = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            if fcntl is None:
                return file
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            with suppress(FileNotFoundError):  # removed by a command that ended since it was opened here
                if os.path.samestat(os.fstat(file), path.stat()):
                    return file
        except OSError as error:
            if error.errno in (errno.ENOLCK, errno.ENOSYS, errno.ENOTSUP):
                return file
            taken = _in_use(folder, file) if error.errno in TAKEN else None
            os.close(file)
            if taken is not None:
                raise FolderInUse(taken) from None
            raise
        os.close(file)  # that of a command which ended just now
