"""Which state of the source code computes: so that results of two states are not mixed in one folder."""

from __future__ import annotations

import hashlib
import os
import platform
import sys
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

REPORTED = ("mars-m3depth", "torch", "numpy", "opencv-python-headless")  # packages whose versions versions() gives


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


def versions() -> dict[str, Any]:
    """Of what the figures depend on; the processor too, because seconds do."""
    found: dict[str, Any] = {"python": platform.python_version(), "machine": platform.machine(), "cpus": os.cpu_count()}
    for package in REPORTED:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = None
    torch = sys.modules.get("torch")
    if torch is not None:
        found["torch_threads"] = torch.get_num_threads()
    return found
