import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from marssim.base.compute.threads import in_threads


def test_results_come_in_order_from_several_threads():
    both = threading.Barrier(2, timeout=30)  # passes only if two jobs run at the same time

    def work(job: int) -> int:
        if job < 2:
            both.wait()
        time.sleep(0.001 * (job % 3))
        return job * job

    assert list(in_threads(work, range(50), 2)) == [job * job for job in range(50)]


def test_after_an_error_no_more_jobs_start(monkeypatch):
    """Eight jobs are under way in two threads: the first one fails, and the second one waits until it is known."""
    started, known = [], threading.Event()

    class Pool(ThreadPoolExecutor):
        def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
            super().shutdown(wait=False, cancel_futures=cancel_futures)
            known.set()
            super().shutdown(wait)

    def work(job: int) -> int:
        started.append(job)
        if job == 0:
            raise OSError("full")
        known.wait(60)
        return job

    monkeypatch.setattr("marssim.base.compute.threads.ThreadPoolExecutor", Pool)
    with pytest.raises(OSError, match="full"):
        list(in_threads(work, range(1000), 2))
    assert len(started) <= 3


def test_jobs_are_taken_as_they_are_needed():
    taken = []

    def jobs():
        for job in range(1000):
            taken.append(job)
            yield job

    results = in_threads(lambda job: job, jobs(), 2)
    next(results)
    assert len(taken) < 20
    results.close()
    assert len(taken) < 20
