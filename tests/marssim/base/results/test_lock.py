import os
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from marssim.base.results import lock
from marssim.base.results.lock import FolderInUse, check_unused, sole_writer

HOLD = """
import sys
from pathlib import Path
from marssim.base.results.lock import sole_writer
with sole_writer(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.readline()
"""
needs_flock = pytest.mark.skipif(lock.fcntl is None, reason="this system has no flock")


def holder(folder: Path) -> subprocess.Popen[str]:
    """Another process that holds the folder until the test lets it go on or kills it."""
    process = subprocess.Popen([sys.executable, "-c", HOLD, str(folder)], stdin=-1, stdout=-1, text=True)
    assert process.stdout is not None and process.stdout.readline() == "held\n"
    return process


def test_the_folder_is_made_and_nothing_stays(tmp_path):
    folder = tmp_path / "a" / "b"
    with sole_writer(folder):
        assert [p.name for p in folder.iterdir()] == [".lock"]
    assert list(folder.iterdir()) == []


def test_where_there_is_no_lock_no_open_file_is_deleted(tmp_path, monkeypatch):
    """Windows has no flock, and does not delete a file that is open."""
    monkeypatch.setattr(lock, "fcntl", None)
    open_files, unlink = [], Path.unlink

    def unlinked(path, **settings):
        with pytest.raises(OSError):
            os.fstat(open_files[-1])
        unlink(path, **settings)

    taken = lock._take
    monkeypatch.setattr(lock, "_take", lambda *given: open_files.append(taken(*given)) or open_files[-1])
    monkeypatch.setattr(Path, "unlink", unlinked)
    with sole_writer(tmp_path / "out"):
        os.fstat(open_files[-1])
    assert list((tmp_path / "out").iterdir()) == [] and len(open_files) == 1


@needs_flock
def test_the_error_of_a_second_writer_names_the_first(tmp_path):
    with (
        sole_writer(tmp_path),
        pytest.raises(FolderInUse, match=rf"^{tmp_path}: another command \(process {os.getpid()} on .*\) is writing"),
        sole_writer(tmp_path),
    ):
        raise AssertionError
    with sole_writer(tmp_path):
        pass


@needs_flock
@pytest.mark.parametrize("ending", [signal.SIGKILL, None])
def test_the_lock_ends_with_its_process(tmp_path, ending):
    process = holder(tmp_path)
    with pytest.raises(FolderInUse, match=f"process {process.pid} on"), sole_writer(tmp_path):
        raise AssertionError
    if ending is not None:
        process.send_signal(ending)
    process.communicate("\n")
    assert (tmp_path / ".lock").exists() == (ending == signal.SIGKILL)  # a file that locks nothing any more
    with sole_writer(tmp_path):
        pass
    assert list(tmp_path.iterdir()) == []


@needs_flock
def test_check_unused_refuses_a_folder_only_while_a_command_writes_to_it(tmp_path):
    check_unused(tmp_path / "nowhere")
    check_unused(tmp_path)
    (tmp_path / ".lock").write_text("process 1 on a machine that was switched off")
    check_unused(tmp_path)
    before = (tmp_path / ".lock").read_bytes()
    process = holder(tmp_path)
    with pytest.raises(FolderInUse, match=f"process {process.pid} on .* is writing here"):
        check_unused(tmp_path)
    process.kill()
    process.communicate()
    check_unused(tmp_path)
    assert before and (tmp_path / ".lock").exists()
    with sole_writer(tmp_path):
        pass


@needs_flock
def test_an_error_releases_the_lock(tmp_path):
    with pytest.raises(KeyError), sole_writer(tmp_path):
        raise KeyError
    with sole_writer(tmp_path):
        pass


@needs_flock
def test_two_writers_never_hold_the_lock_at_once(tmp_path):
    """Many writers come and go. A file that one has deleted is no lock for another that has opened it."""
    inside: list[int] = []

    def visit(number: int) -> tuple[int, int]:
        refused, most = 0, 0
        for _ in range(200):
            try:
                with sole_writer(tmp_path):
                    inside.append(number)
                    most = max(most, len(inside))
                    inside.remove(number)
            except FolderInUse:
                refused += 1
        return refused, most

    with ThreadPoolExecutor(8) as pool:  # whose map raises what a visitor ran into
        visits = list(pool.map(visit, range(8)))
    assert max(most for _, most in visits) == 1 and sum(refused for refused, _ in visits) < 1600


@pytest.mark.parametrize("kind", ["no fcntl", "no locks on this disk"])
def test_without_locks_it_goes_on(tmp_path, monkeypatch, kind):
    if kind == "no fcntl":
        monkeypatch.setattr(lock, "fcntl", None)
    else:

        def none_here(*_: object) -> None:
            raise OSError(37, "No locks available")

        monkeypatch.setattr(lock.fcntl, "flock", none_here)
    with sole_writer(tmp_path), sole_writer(tmp_path):
        pass
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_made_is_named(tmp_path):
    (tmp_path / "file").write_text("mine")
    with pytest.raises(OSError) as error, sole_writer(tmp_path / "file" / "below"):
        raise AssertionError
    assert str(tmp_path / "file") in str(error.value.filename)


def test_a_link_in_the_folder_leads_nowhere(tmp_path):
    """Who made the folder may have laid a link to a file of the user there."""
    others = tmp_path / "others.txt"
    others.write_text("not to be lost")
    folder = tmp_path / "folder"
    folder.mkdir()
    (folder / ".lock").symlink_to(others)
    with pytest.raises(OSError, match=rf"^{folder}/\.lock: is a link, .*; delete it$"), sole_writer(folder):
        raise AssertionError
    check_unused(folder)
    assert others.read_text() == "not to be lost"


def test_a_pipe_in_place_of_the_lock_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / ".lock")
    check_unused(tmp_path)


UNGUARDED = """
from multiprocessing import get_context
from pathlib import Path
from marssim.base.results.lock import sole_writer

with sole_writer(Path(__file__).parent / "out"):
    process = get_context("spawn").Process(target=print)
    process.start()
    process.join()
"""


@needs_flock
def test_a_script_that_its_own_workers_import_is_given_the_remedy(tmp_path):
    (tmp_path / "script.py").write_text(UNGUARDED)
    done = subprocess.run([sys.executable, str(tmp_path / "script.py")], capture_output=True, text=True, check=True)
    last = done.stderr.strip().splitlines()[-1]
    assert "FolderInUse" in last and last.endswith("put what calls it under `if __name__ == '__main__':`")
