"""Read whole files that may come from elsewhere."""

from __future__ import annotations

from pathlib import Path


def read_file(path: Path) -> bytes:
    """Return the content of a file.

    Raises:
        FileNotFoundError: There is nothing at the path.
        OSError: It cannot be read, or is a pipe or a device, which may never end.
    """
    refuse_endless(path)
    return path.read_bytes()


def refuse_endless(path: Path) -> None:
    """Raise OSError if a path leads to a pipe or a device: reading it may never end."""
    if path.is_fifo() or path.is_char_device():
        raise OSError("is a pipe or a device, not a file")
