"""The verdict of a long run finds growth, and takes noise and the first minutes for none."""

import os
import sys

import numpy as np
import pytest
from soak import FEWEST, held, main, run, verdict


def rows(memory, files=20.0):
    return [{"seconds": 5.0 * n, "memory": m, "files": files, "threads": 4.0} for n, m in enumerate(memory)]


@pytest.mark.parametrize("grows", [False, True])
def test_growth_is_distinguished_from_noise_and_from_a_warm_start(grows):
    rng, number = np.random.default_rng(0), 400
    memory = 500 + 300 * (1 - np.exp(-np.arange(number) / 20)) + rng.normal(0, 5, number)
    memory[350] += 400  # a peak
    grew, words = verdict(rows(memory + grows * 0.5 * np.arange(number)))
    assert grew == grows and ("memory GROWS" in words) == grows
    assert verdict(rows([500.0] * FEWEST)) == (False, f"too short for a verdict: {FEWEST // 2} of {FEWEST} lines")


def test_what_a_process_holds_is_counted(tmp_path):
    before = held()
    with (tmp_path / "file").open("w"):
        assert held()["files"] == before["files"] + 1
    assert before["memory"] > 1 and before["threads"] >= 1


@pytest.mark.parametrize("code", [0, 3])
def test_a_command_runs_in_this_process_and_gives_its_exit_code(tmp_path, monkeypatch, capsys, code):
    (tmp_path / "worker.py").write_text("import os, sys\nprint(os.getpid(), *sys.argv[1:])\nsys.exit(int(sys.argv[2]))")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "argv", ["pytest"])
    assert main([str(tmp_path / "logs" / "log.jsonl"), "worker", "--out", str(code)]) == code
    first, last = capsys.readouterr().out.splitlines()
    assert first == f"{os.getpid()} --out {code}"
    assert last.startswith("worker, 0 s: too short")


def test_a_command_that_fails_with_words_or_returns_has_an_exit_code(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "argv", ["pytest"])
    for name, text, code in (("worded", "raise SystemExit('no')", 1), ("quiet", "", 0)):
        (tmp_path / f"{name}.py").write_text(text)
        assert run(name, []) == code
