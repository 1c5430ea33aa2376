"""The version of this distribution, for all of its packages."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version

DISTRIBUTION = "mars-m3depth"


def _installed() -> str:
    try:
        return version(DISTRIBUTION)
    except PackageNotFoundError:  # run from a source tree that is not installed
        return "unknown"


VERSION = _installed()
VERSION_FLAG = "--version"  # flag of every command
VERSION_LINE = f"{DISTRIBUTION} {VERSION}"  # what it prints
