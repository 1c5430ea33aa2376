"""The version of this distribution, for all of its packages."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version

DISTRIBUTION = "mars-m3depth"


def _installed_version() -> str:
    """Return the version of the installed distribution, "unknown" if it is not installed."""
    try:
        return version(DISTRIBUTION)
    except PackageNotFoundError:  # the packages run from a source tree
        return "unknown"


VERSION = _installed_version()
RELEASE = VERSION.partition(".dev")[0]  # the release that this version is, or leads to
VERSION_FLAG = "--version"  # a flag of every command
VERSION_LINE = f"{DISTRIBUTION} {VERSION}"  # what the flag prints
