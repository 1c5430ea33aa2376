"""Identify the source code and the versions that compute results, so that one folder does not mix those of two."""

from __future__ import annotations

import hashlib
import os
import platform
import subprocess
import sys
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

REPORTED = ("mars-m3depth", "torch", "numpy", "opencv-python-headless")  # packages in versions()


@cache
def source_digest(packages: tuple[str, ...]) -> str:
    """Return twelve hexadecimal digits of the SHA-256 over the names and contents of packages' Python sources.

    Args:
        packages: Names of installed packages.
    """
    digest = hashlib.sha256()
    for package in packages:
        file = source_file(package)
        assert file is not None
        for source in sorted(file.parent.rglob("*.py")):
            name = f"{package}/{source.relative_to(file.parent).as_posix()}"
            digest.update(f"{name}\0".encode() + source.read_bytes() + b"\0")
    return digest.hexdigest()[:12]


def source_file(module: str) -> Path | None:
    """Return the file of a module without importing it; None if it has none, as a built-in module."""
    spec = find_spec(module)
    return Path(spec.origin) if spec is not None and spec.has_location and spec.origin else None


@cache
def commit(package: str) -> str | None:
    """Return the git commit of a package's sources, with "-dirty" where tracked files differ from it.

    Args:
        package: Name of an installed package.

    Returns:
        Twelve hexadecimal digits or more; None if the sources are no tracked files of a checkout, or git is missing.
    """
    file = source_file(package)
    assert file is not None
    git = ("git", "-C", str(file.parent))
    try:
        subprocess.run([*git, "ls-files", "--error-unmatch", file.name], capture_output=True, check=True)
        described = [*git, "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"]
        return subprocess.run(described, capture_output=True, check=True, text=True).stdout.strip() or None
    except (OSError, subprocess.CalledProcessError):
        return None


def processor() -> str | None:
    """Return the name of the processor's model; None where the system does not tell it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:  # not Linux
        return platform.processor() or None
    names = (value.strip() for key, _, value in (line.partition(":") for line in lines) if key.strip() == "model name")
    return next(names, None)


def versions() -> dict[str, Any]:
    """Return what figures depend on: the versions of Python and of packages, the commit, and the machine."""
    record: dict[str, Any] = {
        "python": platform.python_version(),
        "machine": platform.machine(),
        "processor": processor(),
        "cpus": os.cpu_count(),
    }
    for package in REPORTED:
        try:
            record[package] = version(package)
        except PackageNotFoundError:
            record[package] = None
    record["commit"] = commit("marssim")
    torch = sys.modules.get("torch")
    if torch is not None:
        record["torch_threads"] = torch.get_num_threads()
    return record


def joined_versions(parts: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the versions of results that several processes or machines computed.

    Args:
        parts: What versions() returned in each of them, or what this function returned of some.

    Returns:
        The value that all have in common, or a list of those that differ, with None where a part has none.
    """
    out: dict[str, list[Any]] = {name: [] for part in parts for name in part}
    for part in parts:
        for name, values in out.items():
            value = part.get(name)
            values += [each for each in (value if isinstance(value, list) else [value]) if each not in values]
    return {name: values[0] if len(values) == 1 else values for name, values in out.items()}
