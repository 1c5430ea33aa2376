"""A check of the files that a command reads."""

from __future__ import annotations

from pathlib import Path


def check_file(path: Path, what: str = "file", advice: str = "") -> None:
    """Check that a path is a file.

    Args:
        path: The path.
        what: Kind of file that is expected, for the message.
        advice: What to give instead, for the end of the message.

    Raises:
        FileNotFoundError: There is nothing at the path. One line that names it, as for the other error.
        IsADirectoryError: The path is a folder.
    """
    end = f"; {advice}" if advice else ""
    if path.is_dir():
        raise IsADirectoryError(f"{path}: is a folder, not a {what}{end}")
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such {what}{end}")
