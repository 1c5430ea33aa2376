import argparse
import sys
from pathlib import Path

import pytest

from marssim.base.command.exits import EndedByCode, HelpPrinted, exits_as_errors
from marssim.base.command.run import exit_code
from marssim.base.compute.workers import run_tasks


def leave(code: object) -> None:
    sys.exit(code)


@pytest.mark.parametrize("code", [0, None, 3, "bye"])
def test_an_exit_in_the_work_is_an_error_that_says_where(code, capsys):
    line = leave.__code__.co_firstlineno + 1
    assert exit_code(lambda: leave(code)) == 2
    message = f"{Path(__file__)}, line {line}: sys.exit({code!r}) ended the command before its work was done"
    assert capsys.readouterr().err == f"error: {message}\n"


def test_the_caller_of_pythons_own_modules_is_named():
    with pytest.raises(EndedByCode, match=rf"^{__file__}, line \d+: sys.exit\(2\)"), exits_as_errors():
        argparse.ArgumentParser().parse_args(["--unknown"])


def test_help_is_no_error():
    with pytest.raises(HelpPrinted), exits_as_errors():
        raise HelpPrinted(0)


def test_an_exit_in_a_task_is_an_error():
    with pytest.raises(EndedByCode, match=rf"^{__file__}, line"):
        run_tasks(leave, [(0,), (0,)], print, workers=2)
