"""Signals that a run records between its steps."""

import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from marssim.base.command import signals
from marssim.base.command.signals import stop_on_signal


@pytest.fixture(params=signals.STOPPING, ids=lambda number: number.name)
def number(request):
    """A signal that raises KeyboardInterrupt, whatever started the tests, and has its former effect afterwards."""
    before = signal.signal(request.param, signal.default_int_handler)
    yield request.param
    signal.signal(request.param, before)


def test_the_first_signal_is_noted_and_the_second_one_ends(number, monkeypatch):
    monkeypatch.delenv("LOCAL_RANK", raising=False)
    monkeypatch.setattr(signals, "REPEAT_WITHIN", 0.0)
    with stop_on_signal() as received:
        signal.raise_signal(number)  # to this thread, and at once
        assert received == [number]
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(number)
    assert signal.getsignal(number) is signal.default_int_handler


@pytest.mark.parametrize("launched", [True, False])
def test_a_signal_that_comes_twice_at_once_is_one(number, monkeypatch, launched):
    """A queue sends it to torchrun, which passes it on, and to all of its processes."""
    monkeypatch.setattr(signals, "REPEAT_WITHIN", 0.0 if launched else 60.0)
    monkeypatch.setenv("LOCAL_RANK", "0") if launched else monkeypatch.delenv("LOCAL_RANK", raising=False)
    with stop_on_signal() as received:
        for _ in range(3):
            signal.raise_signal(number)
        assert received == [number]
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(number)


def test_a_signal_within_the_handler_of_the_first_is_one_too(number, monkeypatch):
    monkeypatch.delenv("LOCAL_RANK", raising=False)
    clock = iter([lambda: signal.raise_signal(number)])

    def time_of_day():
        next(clock, lambda: None)()
        return 1e6

    monkeypatch.setattr(signals.time, "monotonic", time_of_day)
    with stop_on_signal() as received:
        signal.raise_signal(number)
        assert received == [number]


def test_a_signal_that_is_ignored_at_the_start_stays_ignored(number):
    signal.signal(number, signal.SIG_IGN)
    with stop_on_signal() as received:
        signal.raise_signal(number)
        assert received == [] and signal.getsignal(number) == signal.SIG_IGN
    assert signal.getsignal(number) == signal.SIG_IGN


IGNORING = """
import signal, sys
from marssim.base.command.run import exit_code

def work():
    signal.raise_signal(signal.{name})
    print("went on", flush=True)

sys.exit(exit_code(work))
"""


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_a_command_ignores_what_it_was_started_to_ignore(name):
    """A script that starts a command in the background has it ignore SIGINT; `nohup` and its like ignore others."""
    starter = (
        f"import signal, os, sys; signal.signal(signal.{name}, signal.SIG_IGN); os.execv(sys.executable, sys.argv[1:])"
    )
    command = [sys.executable, "-c", IGNORING.format(name=name)]
    done = subprocess.run([sys.executable, "-c", starter, *command], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "went on\n", "")


CLOSED = """
import sys, time
from pathlib import Path
from marssim.base.command.run import exit_code
from marssim.base.command.signals import stop_on_signal

def work():
    if sys.argv[2] == "loop":
        with stop_on_signal() as received:
            print("begun", flush=True)
            while not received:
                time.sleep(0.02)
            print("at work", flush=True)
        Path(sys.argv[1]).write_text("saved")
    else:
        try:
            print("begun", flush=True)
            time.sleep(60)
        finally:
            time.sleep(0.5)
            Path(sys.argv[1]).write_text("saved")

sys.exit(exit_code(work))
"""


@pytest.mark.parametrize(("kind", "code"), [("loop", 2), ("other", 130)])  # 2: nobody can read it
def test_a_terminal_that_is_closed_ends_a_command_in_order(tmp_path, kind, code):
    pty = pytest.importorskip("pty", reason="this system has no terminals of this kind")
    child, terminal = pty.fork()
    if child == 0:
        signal.signal(signal.SIGHUP, signal.SIG_DFL)  # which `nohup` would have the tests ignore
        os.execv(sys.executable, [sys.executable, "-c", CLOSED, str(tmp_path / "result"), kind])
    assert os.read(terminal, 100).startswith(b"begun")
    os.close(terminal)
    time.sleep(0.1)
    os.kill(child, signal.SIGHUP)  # a shell sends another one
    ended, status = 0, 0
    for _ in range(600):
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            break
        time.sleep(0.1)
    else:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
    assert ended == child and os.waitstatus_to_exitcode(status) == code
    assert (tmp_path / "result").read_text() == "saved"


def test_a_thread_runs_without_noting_signals():
    lists = []

    def work():
        with stop_on_signal() as received:
            lists.append(received)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert lists == [[]]
