"""Lock a folder, so that one command at a time writes to it."""

from __future__ import annotations

import errno
import multiprocessing
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from marssim.base.files.no_link import open_no_link

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

LOCK = ".lock"  # name of the lock's file in a folder
TAKEN = (errno.EAGAIN, errno.EACCES)  # errors of flock if another process holds the lock


class FolderInUse(ValueError):
    """Another command writes to the folder; the message names both."""


@contextmanager
def sole_writer(folder: Path) -> Iterator[None]:
    """Lock a folder for as long as the block runs.

    The lock is the operating system's (flock) on the file .lock. It ends with the process, even by kill -9. The file is
    deleted when the block ends; one that a killed command leaves locks nothing. Over NFS, Linux passes the lock on to
    the server, so that it holds between machines too. Where the system or the file system has no such lock (Windows,
    some network disks), nothing is locked.

    Args:
        folder: The folder. It is made if need be.

    Raises:
        FolderInUse: Another command writes to the folder.
        OSError: The folder or the lock's file cannot be made, or the file is a link.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / LOCK
    file = _take(path, folder)
    try:
        with suppress(OSError):  # the name is only for messages, so a full disk is no reason to end here
            os.truncate(file, 0)
            os.write(file, f"process {os.getpid()} on {socket.gethostname()}".encode())
        yield
    finally:
        if fcntl is None:  # Windows deletes no open file
            os.close(file)
            with suppress(OSError):
                path.unlink()
        else:
            path.unlink(missing_ok=True)  # before the lock is released: a waiting command sees this, opens a new file
            os.close(file)


def check_unused(folder: Path) -> None:
    """Check that no command writes to a folder now. Nothing is locked, and nothing is written.

    A lock's file that a killed command has left, or that cannot be read, does not count.

    Args:
        folder: The folder.

    Raises:
        FolderInUse: A command writes to the folder.
    """
    with suppress(OSError):
        file = open_no_link(folder / LOCK, os.O_RDONLY)
        try:
            if fcntl is not None:
                fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno in TAKEN:
                raise FolderInUse(_in_use(folder, file)) from None
        finally:
            os.close(file)


def _in_use(folder: Path, file: int) -> str:
    if getattr(multiprocessing.current_process(), "_inheriting", False):  # as multiprocessing asks itself
        return (
            f"{folder}: a worker process imports your script, which would begin the same work again; put what calls it "
            "under `if __name__ == '__main__':`"
        )
    owner = os.read(file, 200).decode(errors="replace")
    return f"{folder}: another command{f' ({owner})' if owner else ''} is writing here; let it end first"


def _take(path: Path, folder: Path) -> int:
    """Return the file descriptor of the lock's file, locked. Raises FolderInUse or OSError."""
    while True:
        file = open_no_link(path, os.O_RDWR | os.O_CREAT)
        try:
            if fcntl is None:
                return file
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            with suppress(FileNotFoundError):  # a command that has ended since then has deleted it
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
        os.close(file)  # the file is no longer at the path: a command has just ended
