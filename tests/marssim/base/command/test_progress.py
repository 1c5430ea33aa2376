import re
import sys

import pytest

from marssim.base.command import progress as module
from marssim.base.command.progress import progress, watched


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    now = [100.0]
    monkeypatch.setattr(module.time, "monotonic", lambda: now[0])
    return now


def test_a_log_gets_a_line_every_20_s_and_the_last(clock: list[float], capsys: pytest.CaptureFixture[str]) -> None:
    with progress(50, "pair", "generate") as bar:
        for _ in range(50):
            clock[0] += 1
            bar.update()
    assert capsys.readouterr().err.splitlines() == [
        "generate: 20/50 pairs, 00:20, 00:30 to go",
        "generate: 40/50 pairs, 00:40, 00:10 to go",
        "generate: 50/50 pairs, 00:50",
    ]


def test_a_short_task_prints_no_line_to_a_log(clock: list[float], capsys: pytest.CaptureFixture[str]) -> None:
    items = []
    for item in watched("abc", "view", "look"):
        clock[0] += 5
        items.append(item)
    assert items == ["a", "b", "c"]
    assert capsys.readouterr().err == ""


def test_an_interrupted_task_prints_how_far_it_came(clock: list[float], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ValueError), progress(100, "pair", "export") as bar:
        clock[0] += 30
        bar.update(7)
        bar.update(2)
        raise ValueError
    assert capsys.readouterr().err.splitlines()[-1] == "export: 9/100 pairs, 00:30, 05:03 to go"


def test_a_terminal_gets_a_bar(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    assert list(watched([1, 2], "pair", "check")) == [1, 2]
    assert re.search(r"check: 100%.*2/2", capsys.readouterr().err)
