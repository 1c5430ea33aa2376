"""Code of the user that calls sys.exit inside a command: its exit code must not become the command's."""

from __future__ import annotations

import os
import traceback
from collections.abc import Iterator
from contextlib import contextmanager

LIBRARY = os.path.dirname(os.__file__)  # Python's own modules, as argparse, which calls sys.exit for its callers


class HelpPrinted(SystemExit):
    """--help or --version was asked for, and is printed."""


class EndedByCode(ValueError):
    """Some code called sys.exit before the command had done its work; the message says where."""


@contextmanager
def exits_as_errors() -> Iterator[None]:
    """Turn a SystemExit of the block into EndedByCode. HelpPrinted passes."""
    try:
        yield
    except HelpPrinted:
        raise
    except SystemExit as end:
        frames = traceback.extract_tb(end.__traceback__)
        callers = [frame for frame in frames if os.path.dirname(frame.filename) != LIBRARY]
        frame = (callers or frames)[-1]
        raise EndedByCode(
            f"{frame.filename}, line {frame.lineno}: sys.exit({end.code!r}) ended the command before its work was done"
        ) from end
