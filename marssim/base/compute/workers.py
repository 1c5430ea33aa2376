"""Run many independent tasks: in this process, in worker processes, or on a dask cluster."""

from __future__ import annotations

import asyncio
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    wait,
)
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2

from marssim.base.command.notes import GOES_ON, KILLED, shared_turn, take_turn

TASKS_PER_WORKER = 64  # then a process is replaced: what libraries do not free cannot add up, nor what is cached
MOST_GROWTH = 400e6  # [bytes] or sooner, if it holds so much more memory than after its first task
ANSWER_WITHIN = 10.0  # [s] for a scheduler
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "LP_NUM_THREADS")  # the last one: Mesa's

_SPAWN = multiprocessing.get_context("spawn")

Task = tuple[Any, ...]


def run_tasks(
    function: Callable[..., Any],
    tasks: Sequence[Task],
    done: Callable[[Task, Any], object],
    workers: int = 1,
    scheduler: str | None = None,
) -> None:
    """Call function(*task) for each task, and done(task, result) here as each is finished, in whatever order.

    workers: 1 works in this process; more start that many spawned processes of one thread each. scheduler: address of
    a dask scheduler (tcp://host:8786) whose workers do it instead; function and tasks must be importable there.
    The first exception of a task, or of done, ends the run and is raised here. Raises BrokenExecutor if a worker was
    killed, ImportError or OSError if dask is not installed or the scheduler does not answer.
    """
    if scheduler is not None:
        _on_cluster(function, tasks, done, scheduler)
    elif workers == 1:
        for task in tasks:
            done(task, function(*task))
    elif tasks:
        _in_processes(function, tasks, done, min(workers, len(tasks)))


class _Worker:
    """One process that takes one task at a time.

    Not a pool of many with max_tasks_per_child: up to Python 3.14 such a pool can come to stand still once its
    processes are replaced (python/cpython#115634).
    """

    def __init__(self, turn: Any) -> None:
        self.turn = turn  # to speak (marssim.base.command.notes), of all workers together
        self.pool: ProcessPoolExecutor | None = None
        self.processes: set[Any] = set()
        self.held: list[int] = []  # memory after each task

    def submit(self, function: Callable[..., Any], task: Task) -> Future[Any]:
        """The future gives what `taken` takes."""
        if self.pool is None or len(self.held) == TASKS_PER_WORKER or self._grown():
            self.end()
            self.pool, self.held = ProcessPoolExecutor(1, _SPAWN, _start, (self.turn,)), []
            before = set(multiprocessing.active_children())
            with _as_worker():
                future = self.pool.submit(_weighed, function, task)
            self.processes = set(multiprocessing.active_children()) - before
            return future
        return self.pool.submit(_weighed, function, task)

    def taken(self, future: Future[Any]) -> Any:
        """The result of a task that is done. Raises what the task raised."""
        result, held = future.result()
        self.held.append(held)
        return result

    def _grown(self) -> bool:
        return bool(self.held) and self.held[-1] > self.held[0] + MOST_GROWTH

    def end(self, now: bool = False) -> None:
        """now: without waiting for the task at work; what it has half written is made anew in the next run."""
        if now:
            for process in self.processes:
                process.terminate()
        if self.pool is not None:
            self.pool.shutdown()


def _in_processes(
    function: Callable[..., Any], tasks: Sequence[Task], done: Callable[[Task, Any], object], count: int
) -> None:
    turn = shared_turn(_SPAWN)
    workers = [_Worker(turn) for _ in range(count)]
    waiting, idle = list(reversed(tasks)), list(workers)
    running: dict[Future[Any], tuple[_Worker, Task]] = {}
    try:
        while waiting or running:
            while waiting and idle:
                worker, task = idle.pop(), waiting.pop()
                running[worker.submit(function, task)] = worker, task
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                worker, task = running.pop(future)
                idle.append(worker)
                done(task, worker.taken(future))
    except BaseException as error:
        for worker in workers:
            worker.end(now=True)
        if isinstance(error, BrokenExecutor):
            raise BrokenExecutor(KILLED) from None
        raise
    for worker in workers:
        worker.end()


@contextmanager
def _as_worker() -> Iterator[None]:
    """What is started inside uses one thread in each library and leaves Ctrl-C to this process.

    Both are inherited: the libraries read the environment when they are imported, and a signal stays blocked. One that
    comes meanwhile is not lost here.
    """
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT}) if hasattr(signal, "pthread_sigmask") else None
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
        if mask is not None:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def _start(turn: Any) -> None:
    """Begin a worker: one thread for OpenCV too, and an end when the parent is gone, even by kill -9.

    turn: to say what there is to say (marssim.base.command.notes), in the parent's stead; None if there is none.
    """
    cv2.setNumThreads(1)
    take_turn(turn)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _weighed(function: Callable[..., Any], task: Task) -> tuple[Any, int]:
    """The task's result, and how many bytes of memory this process holds after it; 0 where that cannot be read."""
    result = function(*task)
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except OSError:
        return result, 0
    return result, pages * os.sysconf("SC_PAGE_SIZE")


def _end_with(parent: Any) -> None:
    parent.join()
    os._exit(1)


def _one_thread(function: Callable[..., Any], task: Task) -> Any:
    cv2.setNumThreads(1)
    return function(*task)


async def _knock(address: str) -> None:
    """Connect and go. Raises what is wrong with an address, OSError or TimeoutError if no scheduler answers there.

    A Client of a wrong address does not end: it is closed when it is forgotten, which takes 20 s and a traceback.
    """
    from distributed import Security
    from distributed.comm import connect

    how = Security().get_connection_args("client")
    comm = await asyncio.wait_for(connect(address, timeout=ANSWER_WITHIN, **how), ANSWER_WITHIN)
    await comm.close()


def _on_cluster(
    function: Callable[..., Any], tasks: Sequence[Task], done: Callable[[Task, Any], object], address: str
) -> None:
    try:
        from distributed import Client, KilledWorker
    except ImportError:
        raise ImportError("--scheduler needs dask: pip install 'mars-m3depth[cluster]'") from None
    try:
        with ThreadPoolExecutor(1) as elsewhere:  # a notebook has a loop in this thread already
            elsewhere.submit(asyncio.run, _knock(address)).result()
        client = Client(address, timeout=ANSWER_WITHIN, set_as_default=False)
    except OSError:
        raise OSError(f"--scheduler {address}: no answer of a scheduler within {ANSWER_WITHIN:g} s") from None
    except Exception as error:  # each kind of address (tcp, tls, ws, ...) has its own of what is wrong with it
        raise OSError(f"--scheduler {address}: {error}; expected one like tcp://host:8786") from None
    with client, client.get_executor(pure=False) as executor:
        running = {executor.submit(_one_thread, function, task): task for task in tasks}
        try:
            while running:
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    done(running.pop(future), future.result())
        except (KilledWorker, CancelledError):
            raise BrokenExecutor(
                f"--scheduler {address}: it, or several of its workers in turn, was lost; {GOES_ON}"
            ) from None
        finally:
            for future in running:
                future.cancel()
