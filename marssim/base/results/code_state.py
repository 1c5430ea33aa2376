"""Which state of the source code computes: so that results of two states are not mixed in one folder."""

from __future__ import annotations

import hashlib
from functools import cache
from importlib.util import find_spec
from pathlib import Path


@cache
def source_digest(packages: tuple[str, ...]) -> str:
    """Twelve hexadecimal digits that tell one state of these packages' Python sources from another."""
    digest = hashlib.sha256()
    for package in packages:
        file = source_file(package)
        assert file is not None
        for source in sorted(file.parent.rglob("*.py")):
            name = f"{package}/{source.relative_to(file.parent).as_posix()}"
            digest.update(f"{name}\0".encode() + source.read_bytes() + b"\0")
    return digest.hexdigest()[:12]


def source_file(module: str) -> Path | None:
    """The file that a module is read from, which is not imported; None if there is none, as for what is built in."""
    spec = find_spec(module)
    return Path(spec.origin) if spec is not None and spec.has_location and spec.origin else None
