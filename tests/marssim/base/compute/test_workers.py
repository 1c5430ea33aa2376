import logging
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from concurrent.futures import BrokenExecutor
from contextlib import nullcontext
from pathlib import Path

import cv2
import pytest

from marssim.base.compute import workers
from marssim.base.compute.workers import run_tasks


def slow_square(number: int, seconds: float = 0.0) -> int:
    time.sleep(seconds)
    return number * number


def fail_at(number: int, bad: int) -> int:
    if number == bad:
        raise ValueError(f"{number} is bad")
    return number


def fail_first(number: int, folder: Path) -> None:
    """The first task fails; the others last until the file "go" is there."""
    (folder / str(number)).touch()
    if number == 0:
        raise ValueError("0 is bad")
    wait_for(lambda: (folder / "go").exists())


def process_id(_: int) -> int:
    return os.getpid()


def threads(_: int) -> tuple[int, list[str | None]]:
    return cv2.getNumThreads(), [os.environ.get(name) for name in workers.THREADS]


def touch_and_wait(folder: Path, name: str) -> None:
    (folder / name).write_text(str(os.getpid()))
    time.sleep(120)


LOCAL: dict = {}  # by address: a scheduler in this process, and the event that its client was notified


def lose_the_worker(_: int) -> None:
    """What a dask scheduler does when the connection to a worker breaks; here it lives in this process."""
    distributed = pytest.importorskip("distributed")
    worker = distributed.get_worker()
    scheduler, notified = LOCAL[worker.scheduler.address]
    scheduler.loop.add_callback(scheduler.remove_worker, worker.address, stimulus_id="lost")
    notified.wait(60)


def has_ended(pid: int) -> bool:
    """Return whether a process has ended. A zombie has ended too."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except FileNotFoundError:
        return True


def wait_for(what, seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < end, "it did not come to pass"
        time.sleep(0.02)


@pytest.fixture(scope="module")
def cluster():
    distributed = pytest.importorskip("distributed")
    with (
        pytest.MonkeyPatch.context() as patch,
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=False, dashboard_address=":0", silence_logs=50
        ) as local,
    ):
        patch.setattr(workers, "ANSWER_WITHIN", 60.0)  # the machine may be busy
        patch.setattr(workers, "_TASK_LOCK", nullcontext())  # these workers are of one process, others are not
        yield local.scheduler_address


def options_of(where: str, request) -> dict:
    if where == "dask":
        return {"scheduler": request.getfixturevalue("cluster")}
    return {"workers": 3 if where == "processes" else 1}


@pytest.mark.parametrize("where", ["here", "processes", "dask"])
def test_every_task_is_done_once(where, request):
    options = options_of(where, request)
    results = {}
    run_tasks(slow_square, [(n,) for n in range(7)], lambda task, result: results.update({task: result}), **options)
    assert results == {(n,): n * n for n in range(7)}


@pytest.mark.parametrize("where", ["here", "processes", "dask"])
def test_a_tasks_error_reaches_the_caller(where, request):
    options = options_of(where, request)
    results = []
    with pytest.raises(ValueError, match="3 is bad"):
        run_tasks(fail_at, [(n, 3) for n in range(40)], lambda task, result: results.append(result), **options)
    assert 3 not in results and (where != "here" or results == [0, 1, 2])


@pytest.mark.parametrize("where", ["here", "processes", "dask"])
def test_after_a_tasks_error_no_more_are_started(where, request, tmp_path):
    options = options_of(where, request)
    with pytest.raises(ValueError, match="0 is bad"):
        run_tasks(fail_first, [(n, tmp_path) for n in range(40)], print, **options)
    started = len(list(tmp_path.iterdir()))
    (tmp_path / "go").touch()
    run_tasks(slow_square, [(1,)], print, **options)  # comes after what a cluster still has to do
    assert started <= {"here": 1, "processes": 3, "dask": 4}[where]
    assert len(list(tmp_path.iterdir())) - 1 <= (20 if where == "dask" else started)


UNDER_WAY: list[int] = []
TASK_LOCK = workers._TASK_LOCK  # which the fixture of the cluster replaces


def running_tasks(number: int) -> int:
    """Return how many tasks of this process are under way."""
    UNDER_WAY.append(number)
    time.sleep(0.03)
    count = len(UNDER_WAY)
    UNDER_WAY.remove(number)
    return count


def test_the_threads_of_a_worker_of_a_cluster_do_one_task_at_a_time(monkeypatch):
    """Renderers and libraries share state in a process."""
    distributed = pytest.importorskip("distributed")
    options = {"n_workers": 1, "threads_per_worker": 4, "processes": False, "dashboard_address": ":0"}
    monkeypatch.setattr(workers, "ANSWER_WITHIN", 60.0)
    monkeypatch.setattr(workers, "_TASK_LOCK", TASK_LOCK)
    counts = []
    with distributed.LocalCluster(**options, silence_logs=50) as local:
        tasks = [(n,) for n in range(8)]
        run_tasks(running_tasks, tasks, lambda task, count: counts.append(count), scheduler=local.scheduler_address)
    assert counts == [1] * 8


def test_nothing_to_do_starts_nothing(monkeypatch):
    monkeypatch.setattr(workers, "_in_processes", lambda *_: pytest.fail("it started workers"))
    run_tasks(slow_square, [], print, workers=2)


def test_processes_are_replaced_and_the_run_does_not_come_to_stand_still(monkeypatch):
    monkeypatch.setattr(workers, "TASKS_PER_WORKER", 2)
    pids: list[int] = []
    run_tasks(process_id, [(n,) for n in range(9)], lambda _, pid: pids.append(pid), workers=2)
    assert len(pids) == 9 and os.getpid() not in pids
    assert max(pids.count(pid) for pid in pids) <= 2 and all(has_ended(pid) for pid in pids)


def test_a_worker_has_one_thread_and_the_environment_is_left_as_it_was(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    monkeypatch.delenv("MKL_NUM_THREADS", raising=False)
    results = []
    run_tasks(threads, [(0,), (1,)], lambda _, result: results.append(result), workers=2)
    assert results == [(1, ["1"] * len(workers.THREADS))] * 2
    assert os.environ["OMP_NUM_THREADS"] == "2" and "MKL_NUM_THREADS" not in os.environ


def test_a_killed_worker_is_an_error_and_the_others_end_at_once(tmp_path):
    def kill_one() -> None:
        wait_for(lambda: all((tmp_path / name).is_file() and (tmp_path / name).read_text() for name in "ab"))
        os.kill(int((tmp_path / "a").read_text()), signal.SIGKILL)

    killer = threading.Thread(target=kill_one, daemon=True)
    killer.start()
    with pytest.raises(BrokenExecutor, match=r"worker process was killed.*--workers"):
        run_tasks(touch_and_wait, [(tmp_path, "a"), (tmp_path, "b")], print, workers=2)
    killer.join()
    assert has_ended(int((tmp_path / "b").read_text()))


def test_windows_starts_no_tracker_of_resources(monkeypatch):
    """It has none."""
    monkeypatch.delattr(signal, "pthread_sigmask")
    monkeypatch.setattr(workers.resource_tracker, "ensure_running", lambda: pytest.fail("started"))
    with workers.signals_left_to_parent():
        pass


PROGRAM = """
import signal, sys
from pathlib import Path
sys.path.insert(0, {tests!r})
from test_workers import touch_and_wait
from marssim.base.compute.workers import run_tasks
if __name__ == "__main__":
    for number in (signal.SIGINT, signal.SIGHUP):  # what starts in the background would inherit deafness
        signal.signal(number, signal.default_int_handler)
    run_tasks(touch_and_wait, [(Path({folder!r}), "a"), (Path({folder!r}), "b")], print, workers=2)
"""


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT, signal.SIGHUP])
def test_no_worker_outlives_its_parent(tmp_path, number, start_session):
    """A worker must not write while the same command runs again. A terminal signals all, but only one may print."""
    script = tmp_path / "script.py"
    script.write_text(PROGRAM.format(tests=str(Path(__file__).parent), folder=str(tmp_path)))
    process = start_session([sys.executable, str(script)], stderr=subprocess.PIPE, text=True)
    wait_for(lambda: all((tmp_path / name).is_file() and (tmp_path / name).read_text() for name in "ab"))
    if number != signal.SIGKILL:
        os.killpg(process.pid, number)
    else:
        process.kill()
    stderr = process.communicate(timeout=60)[1]
    pids = [int((tmp_path / name).read_text()) for name in "ab"]
    wait_for(lambda: all(has_ended(pid) for pid in pids))
    if number != signal.SIGKILL:
        assert "resource_tracker" not in stderr
        assert stderr.count("KeyboardInterrupt") == 1 and "Process" not in stderr.replace("ProcessPool", "")


def test_a_cluster_without_workers_is_noted(monkeypatch):
    distributed = pytest.importorskip("distributed")
    notes, results = [], []
    monkeypatch.setattr(workers, "_TASK_LOCK", nullcontext())
    with distributed.LocalCluster(
        n_workers=0, threads_per_worker=1, processes=False, dashboard_address=":0", silence_logs=50
    ) as local:
        monkeypatch.setattr(workers, "print_note", lambda line: (notes.append(line), local.scale(1)))
        run_tasks(pow, [(3, 2)], lambda _, result: results.append(result), scheduler=local.scheduler_address)
        run_tasks(pow, [(4, 2)], lambda _, result: results.append(result), scheduler=local.scheduler_address)
    address = local.scheduler_address
    assert notes == [f"--scheduler {address}: has no workers; the work begins when one connects to it"]
    assert results == [9, 16]


def test_a_scheduler_that_does_not_answer_is_one_line(monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr(workers, "ANSWER_WITHIN", 0.5)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
        with pytest.raises(OSError, match=rf"^--scheduler {address}: ") as error:
            run_tasks(slow_square, [(1,)], print, scheduler=address)
    assert len(str(error.value).splitlines()) == 1


@pytest.mark.parametrize("address", ["nonsense", "carrier-pigeon://roof", "tls://127.0.0.1:8786", ""])
def test_an_address_that_is_none_is_one_line_and_no_client_is_made(address, monkeypatch):
    """A client of such an address tries to close when it is forgotten: 20 s, and a traceback."""
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(distributed, "Client", lambda *_, **__: pytest.fail("it made a client"))
    with pytest.raises(OSError, match=rf"^--scheduler {address}: .*; expected one like tcp://host:8786$"):
        run_tasks(slow_square, [(1,)], print, scheduler=address)


def test_a_server_that_is_no_scheduler_is_one_line(monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr(workers, "ANSWER_WITHIN", 0.5)
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        with pytest.raises(OSError, match=rf"^--scheduler {address}: no scheduler answers within 0.5 s$"):
            run_tasks(slow_square, [(1,)], print, scheduler=address)


def test_without_dask_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ImportError, match=r"mars-m3depth\[cluster\]"):
        run_tasks(slow_square, [(1,)], print, scheduler="tcp://127.0.0.1:1")


def test_a_client_does_not_print_the_traceback_of_a_lost_connection(cluster, caplog):
    """An error of one line tells of it."""
    client = logging.getLogger("distributed.client")
    caplog.set_level(logging.ERROR, "distributed.client")
    run_tasks(slow_square, [(1,)], lambda *_: client.error("lost"), scheduler=cluster)
    client.error("of the program that goes on")
    assert [record.message for record in caplog.records if record.name == client.name] == [
        "of the program that goes on"
    ]


def test_a_cluster_whose_workers_die_is_an_error(monkeypatch):
    distributed = pytest.importorskip("distributed")
    import dask

    monkeypatch.setattr(workers, "ANSWER_WITHIN", 60.0)
    options = {"processes": False, "dashboard_address": ":0", "silence_logs": 50}
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        distributed.LocalCluster(n_workers=1, threads_per_worker=1, **options) as local,
    ):
        notified = threading.Event()
        LOCAL[local.scheduler_address] = local.scheduler, notified
        with pytest.raises(BrokenExecutor, match=rf"^--scheduler {local.scheduler_address}: .*lost$"):
            run_tasks(lose_the_worker, [(0,)], print, scheduler=local.scheduler_address)
        notified.set()
        del LOCAL[local.scheduler_address]


class TwoArguments(Exception):
    def __init__(self, one: str, other: str) -> None:
        super().__init__(f"{one} {other}")


def fail_with_two(_: int) -> None:
    raise TwoArguments("my own", "mistake")


def test_an_exception_that_no_process_can_read_keeps_its_text():
    with pytest.raises(RuntimeError, match=r"TwoArguments: my own mistake\n(.|\n)*fail_with_two"):
        run_tasks(fail_with_two, [(1,), (2,)], lambda task, result: None, workers=2)
