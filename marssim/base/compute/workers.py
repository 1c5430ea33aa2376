"""Run many independent tasks: in this process, in worker processes, or on a dask cluster."""

from __future__ import annotations

import asyncio
import logging
import multiprocessing
import os
import pickle
import signal
import threading
import traceback
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
from multiprocessing import resource_tracker
from pathlib import Path
from typing import Any

import cv2

from marssim.base.command.exits import exits_as_errors
from marssim.base.command.notes import permit_for_workers, print_note, use_permit
from marssim.base.command.streams import keep_streams_safe
from marssim.base.command.wording import KILLED

TASKS_PER_WORKER = 64  # tasks after which a process is replaced, so that leaks and caches do not add up
MOST_GROWTH = 400e6  # [bytes] a process is replaced earlier if its memory grows by more than this after its first task
ANSWER_WITHIN = 10.0  # [s] time in which a scheduler must answer
LONGEST_WAIT = 1.0  # [s] after which Windows, which interrupts no wait, learns of a Ctrl-C
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "LP_NUM_THREADS")  # the last one: Mesa's

_SPAWN = multiprocessing.get_context("spawn")
_TASK_LOCK = threading.Lock()  # a worker process of a cluster does one task at a time

Task = tuple[Any, ...]


def run_tasks(
    function: Callable[..., Any],
    tasks: Sequence[Task],
    done: Callable[[Task, Any], object],
    workers: int = 1,
    scheduler: str | None = None,
) -> None:
    """Call function(*task) for each task, in any order. The first exception ends the run and is raised here.

    Args:
        function: Does one task. Worker processes and clusters must be able to import it.
        tasks: The arguments of each call.
        done: Called as done(task, result) in this process, as each task is finished.
        workers: Number of spawned processes, of one thread each; 1 works in this process.
        scheduler: Address of a dask scheduler, tcp://host:8786, whose workers do the tasks instead, one at a time in
            each process.

    Raises:
        BrokenExecutor: A worker was killed.
        ImportError: A scheduler is given, and dask is not installed.
        OSError: The scheduler does not answer.
    """
    if scheduler is not None:
        _on_cluster(function, tasks, done, scheduler)
    elif workers == 1:
        for task in tasks:
            done(task, function(*task))
    elif tasks:
        _in_processes(function, tasks, done, min(workers, len(tasks)))


class _Worker:
    """One process that does one task at a time.

    A single pool with max_tasks_per_child would be simpler, but up to Python 3.14 it can hang once its processes are
    replaced (python/cpython#115634).

    Args:
        permit: Permit of all workers together to print a note; see marssim.base.command.notes.
    """

    def __init__(self, permit: Any) -> None:
        self.permit = permit
        self.pool: ProcessPoolExecutor | None = None
        self.processes: set[Any] = set()
        self.memory: list[int] = []  # [bytes] after each task of the process

    def submit(self, function: Callable[..., Any], task: Task) -> Future[Any]:
        """Start a task, in a new process if the present one is due. `result` takes the future."""
        if self.pool is None or len(self.memory) == TASKS_PER_WORKER or self._has_grown():
            self.end()
            self.pool, self.memory = ProcessPoolExecutor(1, _SPAWN, _start, (self.permit,)), []
            before = set(multiprocessing.active_children())
            with _environment_of_workers():
                future = self.pool.submit(_call_and_weigh, function, task)
                self.processes = set(multiprocessing.active_children()) - before  # before a Ctrl-C is raised
            return future
        return self.pool.submit(_call_and_weigh, function, task)

    def result(self, future: Future[Any]) -> Any:
        """Return the result of a finished task. Raises what the task raised."""
        result, memory = future.result()
        self.memory.append(memory)
        return result

    def _has_grown(self) -> bool:
        return bool(self.memory) and self.memory[-1] > self.memory[0] + MOST_GROWTH

    def end(self, terminate: bool = False) -> None:
        """End the process.

        Args:
            terminate: Do not wait for its task. The next run makes again what the task has half written.
        """
        if terminate:
            for process in self.processes:
                process.terminate()
        if self.pool is not None:
            self.pool.shutdown()


def _in_processes(
    function: Callable[..., Any], tasks: Sequence[Task], done: Callable[[Task, Any], object], count: int
) -> None:
    with signals_left_to_parent():
        permit = permit_for_workers(_SPAWN)
    workers = [_Worker(permit) for _ in range(count)]
    waiting, idle = list(reversed(tasks)), list(workers)
    running: dict[Future[Any], tuple[_Worker, Task]] = {}
    try:
        while waiting or running:
            while waiting and idle:
                worker, task = idle.pop(), waiting.pop()
                running[worker.submit(function, task)] = worker, task
            for future in wait(running, timeout=LONGEST_WAIT, return_when=FIRST_COMPLETED).done:
                worker, task = running.pop(future)
                idle.append(worker)
                done(task, worker.result(future))
    except BaseException as error:
        for worker in workers:
            worker.end(terminate=True)
        if isinstance(error, BrokenExecutor):
            raise BrokenExecutor(KILLED) from None
        raise
    for worker in workers:
        worker.end()


@contextmanager
def _environment_of_workers() -> Iterator[None]:
    """Let processes that start in the block use one thread in each library, and ignore Ctrl-C and a closed terminal.

    They inherit both: libraries read the environment when they are imported, and a blocked signal stays blocked. This
    process handles a signal of that time after the block.
    """
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        with signals_left_to_parent():
            yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@contextmanager
def signals_left_to_parent() -> Iterator[None]:
    """Block the signals of a terminal, so that processes that start in the block never get them.

    Neither does the tracker of resources, which a first semaphore or process would start; it ignores SIGINT alone.
    """
    if not hasattr(signal, "pthread_sigmask"):  # on Windows
        yield
        return
    blocked = {signal.SIGINT, signal.SIGHUP}
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, blocked)
    try:
        resource_tracker.ensure_running()  # which unblocks SIGINT
        signal.pthread_sigmask(signal.SIG_BLOCK, blocked)
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def _start(permit: Any) -> None:
    """Prepare a worker process: one thread for OpenCV, and an end when the parent ends, even by kill -9.

    Args:
        permit: Permit of all workers together to print a note; None for none.
    """
    if not hasattr(signal, "pthread_sigmask"):  # on Windows, where signals_left_to_parent does nothing
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    cv2.setNumThreads(1)
    keep_streams_safe()
    use_permit(permit)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _call_and_weigh(function: Callable[..., Any], task: Task) -> tuple[Any, int]:
    """Return the task's result and the memory of this process after it [bytes]; 0 where it cannot be read."""
    try:
        with exits_as_errors():
            result = function(*task)
    except Exception as error:
        if _can_be_sent(error):
            raise
        lines = "".join(traceback.format_exception(error))
        raise RuntimeError(f"{type(error).__name__}: {error}\n{lines}") from None
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except OSError:
        return result, 0
    return result, pages * os.sysconf("SC_PAGE_SIZE")


def _can_be_sent(error: Exception) -> bool:
    """Return whether another process can read an exception, which its class may prevent."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return False
    return True


def _end_with(parent: Any) -> None:
    parent.join()
    os._exit(1)


def _one_at_a_time(function: Callable[..., Any], task: Task) -> Any:
    """Do a task on a cluster. Other threads of the worker wait: renderers and libraries share state in a process."""
    with _TASK_LOCK:
        cv2.setNumThreads(1)
        with exits_as_errors():
            return function(*task)


async def _check_address(address: str) -> None:
    """Connect to a scheduler and disconnect.

    A Client of a wrong address is not closed before it is collected as garbage, which takes 20 s and prints a
    traceback. So the address is checked first.

    Raises:
        OSError: No scheduler answers.
        Exception: The address is malformed. Each kind of address has its own exceptions.
    """
    from distributed import Security
    from distributed.comm import connect

    security = Security().get_connection_args("client")
    connection = await asyncio.wait_for(connect(address, timeout=ANSWER_WITHIN, **security), ANSWER_WITHIN)
    await connection.close()


@contextmanager
def _silent(name: str) -> Iterator[None]:
    """Keep a logger from printing the traceback of a lost connection, which ends a command in one line.

    Args:
        name: Name of the logger.
    """
    logger = logging.getLogger(name)
    level = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        logger.setLevel(level)


def _on_cluster(
    function: Callable[..., Any], tasks: Sequence[Task], done: Callable[[Task, Any], object], address: str
) -> None:
    try:
        from distributed import Client, KilledWorker
    except ImportError:
        raise ImportError('--scheduler needs dask: pip install "mars-m3depth[cluster]"') from None
    try:
        with ThreadPoolExecutor(1) as thread:  # another one, since a notebook runs an event loop in this one
            thread.submit(asyncio.run, _check_address(address)).result()
        client = Client(address, timeout=ANSWER_WITHIN, set_as_default=False)
    except OSError:
        raise OSError(f"--scheduler {address}: no scheduler answers within {ANSWER_WITHIN:g} s") from None
    except Exception as error:  # each kind of address (tcp, tls, ws, ...) has its own exceptions
        raise OSError(f"--scheduler {address}: {error}; expected one like tcp://host:8786") from None
    with _silent("distributed.client"), client, client.get_executor(pure=False) as executor:
        if not client.scheduler_info()["workers"]:
            print_note(f"--scheduler {address}: has no workers; the work begins when one connects to it")
        running = {executor.submit(_one_at_a_time, function, task): task for task in tasks}
        try:
            while running:
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    done(running.pop(future), future.result())
        except (KilledWorker, CancelledError):
            raise BrokenExecutor(
                f"--scheduler {address}: the connection to it, or to several workers in turn, was lost"
            ) from None
        finally:
            for future in running:
                future.cancel()
