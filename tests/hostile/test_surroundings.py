"""Full and read-only disks, limits, closed streams, locales and missing folders decide over no result."""

import os
import random
import shutil
from pathlib import Path

import pytest
from oracle import cases, count, only_in_make_hostile, rng_of
from processes import fresh
from small_runs import RUNS, SHORT, differing, left_over, results
from surroundings import PAGE, STARTS, make_read_only, small_disk
from tally import NO_MOUNT

pytestmark = only_in_make_hostile
MESSAGE = 2000  # [bytes] for stderr, which is a file too
LINKED = ("log.jsonl", "results.json", "weights.safetensors", "checkpoint.pt", ".results.json.1.part")
ON_DISKS = (*SHORT, "m3depth.train", "envs.evaluate", "m3depth.evaluate")  # those of SHORT come more often


@pytest.fixture
def rng(request) -> random.Random:
    return rng_of(request.node.name)


def draw(rng: random.Random) -> str:
    return rng.choice(ON_DISKS if rng.random() < 0.3 else SHORT)


def goes_on(command, server, inputs, whole, out):
    """Check that the same command completes a folder to the results of an undisturbed run."""
    run = RUNS[command]
    ended = server.run(run.entry, run.line(out, inputs))
    assert ended.code == 0, ended.stderr
    assert not left_over(out) and not list(differing(whole(command).results, results(run, out)))


def test_a_full_disk_is_one_line_and_costs_no_result(server, inputs, whole, rng, tmp_path):
    for number in cases(0.12):
        command = draw(rng)
        run, disk = RUNS[command], tmp_path / f"disk{number}"
        pages = 1 + round(1.2 * rng.random() * whole(command).total / PAGE)
        with small_disk(disk, pages) as mounted:
            if not mounted:
                pytest.skip(NO_MOUNT)
            ended = server.run(run.entry, run.line(disk / "out", inputs))
            ended.check(str(disk), "disk")
            out = tmp_path / "out"
            if (disk / "out").exists():
                shutil.copytree(disk / "out", out)
        count(command, "full disk")
        if ended.code == 0 or number % 4 == 0:
            goes_on(command, server, inputs, whole, out)
        shutil.rmtree(out, ignore_errors=True)


def test_a_limit_on_files_is_one_line_and_costs_no_result(server, inputs, whole, rng, tmp_path):
    for number in cases(0.12):
        command, out = draw(rng), tmp_path / str(number)
        run = RUNS[command]
        limit = MESSAGE + round(whole(command).largest ** rng.random())
        ended = server.run(run.entry, run.line(out, inputs), file_size=limit)
        ended.check(str(out), "file too large")
        count(command, "file-size limit")
        if ended.code == 0 or number % 4 == 0:
            goes_on(command, server, inputs, whole, out)
        shutil.rmtree(out, ignore_errors=True)


def test_a_read_only_folder_is_one_line(server, inputs, rng, tmp_path):
    for number in cases(0.12):
        command, disk = draw(rng), tmp_path / str(number)
        run, out = RUNS[command], disk / rng.choice((".", "out", "a/b"))
        with small_disk(disk, 2000) as mounted:
            if mounted:
                make_read_only(disk)
            elif os.geteuid() == 0:
                pytest.skip(f"{NO_MOUNT}, and permissions do not bind root")
            else:
                disk.chmod(0o555)
            ended = server.run(run.entry, run.line(out, inputs))
        ended.check("--out")
        assert ended.code == 2
        count(command, "read-only folder")


def test_nothing_is_written_through_links_in_the_folder(server, inputs, whole, rng, tmp_path):
    """As in an untrusted folder, whose files may be links to those of the user."""
    for number in cases(0.12):
        command, out, others = draw(rng), tmp_path / str(number), tmp_path / "others"
        run = RUNS[command]
        if rng.random() < 0.7:
            server.run(run.entry, run.line(out, inputs)).check()
        out.mkdir(exist_ok=True)
        others.mkdir()
        files = sorted(path for path in out.rglob("*") if path.is_file())
        linked = [*rng.sample(files, min(2, len(files))), out / ".lock", out / rng.choice(LINKED)]
        if files:
            rng.choice(files).unlink()  # so that there is something to do
        for n, path in enumerate(dict.fromkeys(linked)):
            other = others / str(n)
            other.write_bytes(path.read_bytes() if path.exists() else b"not to be lost")
            path.unlink(missing_ok=True)
            path.symlink_to(other)
        before = {path: path.read_bytes() for path in others.iterdir()}
        server.run(run.entry, run.line(out, inputs)).check(str(out), "--out")
        assert before == {path: path.read_bytes() for path in others.iterdir()}, (command, linked)
        count(command, "links")
        shutil.rmtree(others)
        shutil.rmtree(out)


def test_nothing_is_written_through_a_link_in_place_of_a_folder(server, inputs, whole, rng, tmp_path):
    for number in cases(0.12):
        command, out, others = draw(rng), tmp_path / str(number), tmp_path / "others"
        run = RUNS[command]
        server.run(run.entry, run.line(out, inputs)).check()
        if folders := sorted(path for path in out.rglob("*") if path.is_dir()):
            linked = rng.choice(folders)
            linked.rename(others)
            linked.symlink_to(others)
            if rng.random() < 0.5:
                next(path for path in others.rglob("*") if path.is_file()).unlink()  # so that there is something to do
            before = {path: path.read_bytes() for path in others.rglob("*") if path.is_file()}
            server.run(run.entry, run.line(out, inputs)).check(str(out), "--out")
            assert before == {path: path.read_bytes() for path in others.rglob("*") if path.is_file()}, linked
            shutil.rmtree(others)
        count(command, "links")
        shutil.rmtree(out)


@pytest.mark.parametrize("kind", STARTS)
def test_how_an_interpreter_starts_decides_over_no_result(kind, inputs, whole, rng, tmp_path):
    for number in cases(0.12):
        command = rng.choice(SHORT)
        run, out, start = RUNS[command], tmp_path / str(number), STARTS[kind][number % len(STARTS[kind])]
        ended = fresh(run.entry, run.line(out, inputs), None, start.shell, env=start.environment())
        if start.may_fail:
            ended.check("stdout")
        else:
            assert ended.code == 0, f"{start}: {ended.stderr}"
        assert "Traceback" not in ended.stderr, f"{start}: {ended.stderr}"
        count(command, kind)
        assert not left_over(out) and not list(differing(whole(command).results, results(run, out))), start
        shutil.rmtree(out)


def test_a_working_directory_that_was_removed_is_one_line(inputs, rng, tmp_path):
    for number in cases(0.12):
        command, removed, out = rng.choice(SHORT), tmp_path / "removed", tmp_path / str(number)
        removed.mkdir()

        def before(removed=removed):
            os.chdir(removed)
            removed.rmdir()

        line = RUNS[command].line(rng.choice((out, Path("out"))), inputs)
        ended = fresh(RUNS[command].entry, line, before)
        ended.check("working directory")
        assert ended.code == 2 and not out.exists()
        count(command, "removed folder")
