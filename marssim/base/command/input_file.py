"""Files that a command is given to read."""

from __future__ import annotations

from pathlib import Path


def check_file(path: Path, what: str = "file") -> None:
    """Raise FileNotFoundError or IsADirectoryError, in one line that names it, unless `path` is a file.

    what: the kind of file that is expected, for the message.
    """
    if path.is_dir():
        raise IsADirectoryError(f"{path}: is a folder, not a {what}")
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such {what}")
