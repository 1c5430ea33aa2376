"""The files that a class of a user's reads, such as a checkpoint: with its module, they identify the method."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable
from pathlib import Path

from m3depth.user_module import import_user_module

FILES = "files"  # the attribute of a class that names them


def class_files(name: str) -> tuple[Path, ...]:
    """Return the files that a class names in its attribute `files`: a path, or a list of paths.

    Args:
        name: "package.module:Class".

    Returns:
        Nothing for a class without the attribute, or where it is a method, a property or None; for one that cannot be
        imported, which load_estimator explains; and for names that are no class.

    Raises:
        ValueError: The attribute is something else; the message names the class.
    """
    module, _, attribute = name.partition(":")
    try:
        named = getattr(getattr(import_user_module(module), attribute), FILES, ())
    except Exception:  # whatever a module of the user raises
        return ()
    if named is None or callable(named) or isinstance(named, property):
        return ()
    paths = [named] if isinstance(named, str | os.PathLike) else named
    if not isinstance(paths, list | tuple) or not all(isinstance(path, str | os.PathLike) for path in paths):
        raise ValueError(f"{name}: its attribute {FILES} must be a path or a list of paths, got {named!r:.60}")
    return tuple(Path(path) for path in paths)


def joint_digest(paths: Iterable[Path]) -> str:
    """Return the SHA-256 of a file, or of several: that of their SHA-256, one a line. A folder stands for its files.

    Raises:
        OSError: A file is missing or cannot be read.
    """
    files = [file for path in paths for file in (_files_in(path) if path.is_dir() else [path])]
    digests = [_digest(file) for file in files]
    return digests[0] if len(digests) == 1 else hashlib.sha256("\n".join(digests).encode()).hexdigest()


def _files_in(folder: Path) -> list[Path]:
    """Return the files in a folder, in an order that is the same on all systems."""
    return sorted((path for path in folder.rglob("*") if path.is_file()), key=lambda path: path.as_posix())


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
