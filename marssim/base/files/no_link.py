"""Open files in place, but no links: in a folder that others have filled, a link may lead to any file."""

from __future__ import annotations

import errno
import os
from pathlib import Path

from marssim.base.files.atomic import naming

# Windows has neither flag. A pipe would wait for its other end without the second.
NO_LINK = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)


def open_no_link(path: Path, flags: int) -> int:
    """Return a file descriptor of a file that is no link.

    Args:
        path: The file.
        flags: As os.open takes them.

    Raises:
        OSError: The file is a link, or cannot be opened. The error names it.
    """
    refused = OSError(f"{path}: is a link, through which nothing is written; delete it")
    if not hasattr(os, "O_NOFOLLOW") and path.is_symlink():
        raise refused
    try:
        return os.open(path, flags | NO_LINK, 0o666)
    except OSError as error:
        if path.is_symlink():
            raise refused from None
        raise error


def append_line(path: Path, line: str) -> None:
    """Add a line to a log in one write. The file is made if need be.

    Args:
        path: The file.
        line: The line, without its end.

    Raises:
        OSError: The file is a link, or cannot be written. The error names it. No part of the line is left in it.
    """
    descriptor, data = open_no_link(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT), f"{line}\n".encode()
    with naming(path), open(descriptor, "ab", buffering=0) as file:
        size = os.fstat(descriptor).st_size
        if file.write(data) < len(data):  # a disk that is nearly full takes a part of it, and is silent
            file.truncate(size)
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
