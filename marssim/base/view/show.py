"""What --view does: open the page, print its address, and wait for Ctrl-C."""

from __future__ import annotations

import os
import sys
import time
import webbrowser
from collections.abc import Mapping, Sequence
from importlib.util import find_spec

from marssim.base.view.page import Page
from marssim.base.view.scene import Shot


def check_viewer() -> None:
    """Check that a page can be shown, before a command begins its work.

    Raises:
        ImportError: viser is not installed; one line that says how to install it.
    """
    if find_spec("viser") is None:
        raise ImportError('the viewer in the browser needs viser: pip install "mars-m3depth[view]"')


def show(shots: Sequence[Shot], title: str) -> None:
    """Show shots on a page until Ctrl-C or another signal that stops it; they end it without an error.

    Args:
        shots: What it shows, at least one.
        title: Title of the page.

    Raises:
        ImportError: viser is not installed.
        ValueError, OSError: The first shot cannot be read.
    """
    check_viewer()
    try:
        with Page(shots, title) as page:
            print("\n".join(directions(page.address, os.environ)), flush=True)
            if has_desktop(os.environ):
                webbrowser.open(page.address)
            while True:
                time.sleep(3600)
    except KeyboardInterrupt:
        print()


def directions(address: str, environment: Mapping[str, str]) -> list[str]:
    """Return the lines that say where the page is, and how to reach it from where the user sits.

    Args:
        address: Address of the page.
        environment: Variables of the process.
    """
    lines = [f"view: {address} shows it in a browser; Ctrl-C ends it"]
    if "SSH_CONNECTION" in environment:
        place = address.removeprefix("http://")
        port = place.rpartition(":")[2]
        lines.append(f"view: from your own computer, run `ssh -N -L {port}:{place} HOST` there first")
    return lines


def has_desktop(environment: Mapping[str, str]) -> bool:
    """Return whether a browser that opens here is one that the user sees.

    Args:
        environment: Variables of the process.
    """
    if "SSH_CONNECTION" in environment:
        return False
    return sys.platform in ("darwin", "win32") or any(name in environment for name in ("DISPLAY", "WAYLAND_DISPLAY"))
