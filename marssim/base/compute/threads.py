"""Run many small jobs that wait for the disk or compute in C, in a few threads."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

Job = TypeVar("Job")
Result = TypeVar("Result")


def in_threads(work: Callable[[Job], Result], jobs: Iterable[Job], threads: int) -> Iterator[Result]:
    """Yield the result of each job, in the order of the jobs.

    At most four times as many jobs as threads are under way, so that few results wait in memory. No further job starts
    once a job fails or the caller stops taking results.

    Args:
        work: Does one job. Its exceptions are raised here.
        jobs: The jobs.
        threads: Number of threads.
    """
    with ThreadPoolExecutor(threads) as pool:
        pending: deque[Future[Result]] = deque()
        try:
            for job in jobs:
                pending.append(pool.submit(work, job))
                if len(pending) >= 4 * threads:
                    yield pending.popleft().result()
            while pending:
                yield pending.popleft().result()
        finally:
            pool.shutdown(cancel_futures=True)
