"""The files that a class of a user's reads, such as a checkpoint: with its module, they identify the method."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable
from importlib import import_module
from pathlib import Path

FILES = "files"  # the attribute of a class that names them


def class_files(name: str) -> tuple[Path, ...]:
    """Return the files that a class names in its attribute `files`: a path, or a list of paths.

    Args:
        name: "package.module:Class".

    Returns:
        Nothing for a class without the attribute, for one that cannot be imported, which load_estimator explains, and
        for names that are no class.

    Raises:
        ValueError: The attribute is something else; the message names the class.
    """
    module, _, attribute = name.partition(":")
    try:
        named = getattr(getattr(import_module(module), attribute), FILES, ())
    except Exception:  # whatever a module of the user raises
        return ()
    paths = [named] if isinstance(named, str | os.PathLike) else named
    if not isinstance(paths, list | tuple) or not all(isinstance(path, str | os.PathLike) for path in paths):
        raise ValueError(f"{name}: its attribute {FILES} must be a path or a list of paths, got {named!r:.60}")
    return tuple(Path(path) for path in paths)


def joint_digest(files: Iterable[Path]) -> str:
    """Return the SHA-256 of a file, or of several: that of their SHA-256, one a line.

    Raises:
        OSError: A file is missing or cannot be read.
    """
    digests = [hashlib.sha256(file.read_bytes()).hexdigest() for file in files]
    return digests[0] if len(digests) == 1 else hashlib.sha256("\n".join(digests).encode()).hexdigest()
