"""The real command, killed and starved: nothing is harmed, and the same command goes on to the same bytes."""

import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from marssim.dataset import StereoDataset
from marssim.generate import main

FLAGS = ["--pairs", "8", "--views-per-scene", "2", "--renderer", "embree", "--seed", "9", "--scene", "gale"]
FLAGS += ["--rocks.k", "0.02", "--rig.width", "64", "--rig.height", "48", "--rig.focal", "70", "--trajectory"]
FLAGS += ["--size", "16", "--horizon", "24"]


def command(out: Path, *more: str) -> list[str]:
    return [sys.executable, "-m", "marssim.generate", "--out", str(out), *FLAGS, *more]


def finish(out: Path, *more: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command(out, *more), capture_output=True, text=True)


def contents(path: Path) -> dict[str, bytes]:
    return {str(p.relative_to(path)): p.read_bytes() for p in path.rglob("*") if p.is_file()}


def samples(out: Path) -> list[Path]:
    return sorted(out.glob("scenes/*/[0-9]*/sample.json"))


def told_in_a_line(done: subprocess.CompletedProcess[str]) -> str:
    """The one line of a command that refused."""
    assert done.returncode == 2 and done.stdout == "", done.stderr
    assert done.stderr.startswith("error: ") and done.stderr.count("\n") == 1, done.stderr
    assert "[Errno" not in done.stderr
    return done.stderr.strip()


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("undisturbed") / "set"
    done = finish(out)
    assert done.returncode == 0, done.stderr
    assert len(StereoDataset(out)) == 8
    return out


def test_killed_at_any_moment_it_goes_on_to_the_same_bytes(undisturbed, tmp_path):
    out = tmp_path / "set"
    moments = (
        ((), lambda: any(out.glob("scenes/*/.*"))),  # half a sample
        (("--workers", "2"), lambda: len(samples(out)) >= 3),
        ((), lambda: len(samples(out)) >= 6),
    )
    kept: dict[str, bytes] = {}
    for more, reached in moments:
        process = subprocess.Popen(command(out, *more), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        end = time.monotonic() + 120
        while process.poll() is None and not reached() and time.monotonic() < end:
            time.sleep(0.002)
        process.send_signal(signal.SIGKILL)
        assert process.wait() == -signal.SIGKILL
        time.sleep(0.3)  # workers end with it
        there = {str(s.parent.relative_to(out)): (s.parent / "left.png").read_bytes() for s in samples(out)}
        assert kept.items() <= there.items()
        kept = there
    assert len(kept) >= 6
    assert finish(out, "--workers", "2").returncode == 0
    assert contents(out) == contents(undisturbed)


def test_a_disk_that_fills_up_names_the_place_and_harms_nothing(undisturbed, tmp_path):
    """Here no file may grow beyond what some, but not all, files of the first samples need."""
    out = tmp_path / "set"
    sizes = [(undisturbed / "scenes/00000/00" / name).stat().st_size for name in ("left.png", "depth.png")]
    limit = max((undisturbed / "generate.json").stat().st_size, min(sizes)) + 100
    assert limit < max(p.stat().st_size for p in undisturbed.glob("scenes/00000/00/*"))

    def starve() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    done = subprocess.run(command(out, "--workers", "2"), capture_output=True, text=True, preexec_fn=starve)
    assert f"{out}/scenes/" in told_in_a_line(done) and "file too large" in done.stderr
    assert samples(out) == [] and not (out / "dataset.json").exists()
    assert finish(out).returncode == 0
    assert contents(out) == contents(undisturbed)


@pytest.fixture
def small_disk(tmp_path):
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=96k", "tmpfs", str(folder)]
    if shutil.which("mount") is None or subprocess.run(mount, capture_output=True).returncode != 0:
        pytest.skip("may not mount a tmpfs here")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def test_a_full_disk_leaves_what_is_complete_and_goes_on_when_there_is_room(undisturbed, small_disk, tmp_path):
    line = told_in_a_line(finish(small_disk / "set"))
    assert "no space left on device" in line and str(small_disk / "set") in line
    done = samples(small_disk / "set")
    assert 0 < len(done) < 8
    out = tmp_path / "set"
    shutil.copytree(small_disk / "set", out)
    assert finish(out).returncode == 0
    assert contents(out) == contents(undisturbed)


def refused(capfd, out: Path, *more: str) -> str:
    """The one line of the command, called in this process."""
    code = main(["--out", str(out), *FLAGS, *more])
    said = capfd.readouterr()
    return told_in_a_line(subprocess.CompletedProcess([], code, said.out, said.err))


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="no /proc here")
def test_a_folder_that_cannot_be_made_is_one_line(capfd):
    """Root may write into any folder of a disk, but not into /proc."""
    assert "/proc/marssim-set" in refused(capfd, Path("/proc/marssim-set"))


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_an_unwritable_folder_is_one_line(tmp_path, capfd):
    tmp_path.chmod(0o555)
    assert str(tmp_path) in refused(capfd, tmp_path / "set")


@pytest.mark.parametrize("kind", ["broken", "empty", "missing", "nan"])
def test_a_broken_heightmap_is_named_before_anything_is_written(tmp_path, capfd, kind):
    file = tmp_path / "map.npy"
    if kind == "nan":
        np.save(file, np.full((200, 200), np.nan))
    elif kind != "missing":
        file.write_bytes(b"no heights" if kind == "broken" else b"")
    flags = ("--relief.heightmap", str(file), "--relief.heightmap-scale", "1")
    assert str(file) in refused(capfd, tmp_path / "set", *flags)
    assert not (tmp_path / "set").exists()


def test_memory_does_not_grow_with_the_number_of_scenes(tmp_path):
    """One process that renders scene after scene, as a worker does until it is replaced."""
    program = """
import resource, sys
from pathlib import Path
from marssim.generate_config import parse_generate
from marssim.generate import _claim
from marssim.scene_views import generate_scene
config = parse_generate("generate", None, sys.argv[1:])
_claim(config)
for scene in range(12):
    generate_scene(config, scene, [0])
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024)
"""
    flags = ["--out", str(tmp_path / "set"), *FLAGS, "--no-trajectory"]
    done = subprocess.run([sys.executable, "-c", program, *flags], capture_output=True, text=True, check=True)
    peaks = [int(line) for line in done.stdout.split()]
    assert peaks[-1] - peaks[3] < 60, peaks  # [MB]; a scene alone takes more
