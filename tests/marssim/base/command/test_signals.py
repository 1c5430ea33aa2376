"""Signals noticed while a run takes its steps."""

import signal
import threading

import pytest

from marssim.base.command.signals import stop_on_signal


def test_the_first_signal_is_noted_and_the_second_one_ends():
    before = signal.getsignal(signal.SIGINT)
    with stop_on_signal() as received:
        signal.raise_signal(signal.SIGINT)  # to this thread, and at once
        assert received == [signal.SIGINT]
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)  # to this thread, and at once
    assert signal.getsignal(signal.SIGINT) is before


def test_a_thread_runs_without():
    seen = []

    def work():
        with stop_on_signal() as received:
            seen.append(received)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [[]]
