"""What must come of any attack: the work is done, or one line on stderr says what is wrong."""

from __future__ import annotations

import os
from collections.abc import Callable

import pytest

from marssim.base.command.run import exit_code

CASES = int(os.environ.get("HOSTILE_CASES", "6"))  # of each kind of attack; `make hostile` asks for more
SAME = "HOSTILE_CASES" not in os.environ  # the few of `make test` are the same in each run


def judge(work: Callable[[], object], capsys: pytest.CaptureFixture[str], *names: str) -> int:
    """Do the work as a command does it, check what it leaves, and return its exit code.

    Args:
        work: Reads what is hostile.
        capsys: Captures what is printed.
        names: Words of which a refusal must hold one: the attacked flags, or the file.
    """
    capsys.readouterr()
    code = exit_code(work)
    error = capsys.readouterr().err
    assert code in (0, 2), error
    if code == 2:
        assert error.startswith("error: ") and error.count("\n") == 1, error
        assert any(name in error for name in names), f"{error}: names none of {names}"
    return code
