"""The command is killed or runs out of disk or memory; the same command then completes the same bytes."""

import os
import resource
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from marssim.base.dataset.dataset import StereoDataset
from marssim.generate import main

FLAGS = ["--pairs", "4", "--views-per-scene", "2", "--renderer", "embree", "--seed", "9", "--scene", "utopia"]
FLAGS += ["--rocks.k", "0.02", "--rig.width", "48", "--rig.height", "48", "--rig.focal", "60", "--trajectory"]
FLAGS += ["--size", "12", "--horizon", "16"]


def finish(out: Path, *more: str) -> int:
    """Return the exit code of the command, called in this process."""
    return main(["--out", str(out), *FLAGS, *more])


def contents(path: Path) -> dict[str, bytes]:
    return {str(p.relative_to(path)): p.read_bytes() for p in path.rglob("*") if p.is_file()}


def samples(out: Path) -> list[Path]:
    return sorted(out.glob("scenes/*/[0-9]*/sample.json"))


def error_line(code: int, output: str, error: str) -> str:
    """Return the error message of a command, which must be one line."""
    assert code == 2 and output == "", error
    assert error.startswith("error: ") and error.count("\n") == 1, error
    assert "[Errno" not in error
    return error.strip()


def refused(capfd, out: Path, *more: str) -> str:
    """Return the error message of the command, called in this process."""
    code = finish(out, *more)
    output = capfd.readouterr()
    return error_line(code, output.out, output.err)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("undisturbed") / "set"
    assert finish(out) == 0
    assert len(StereoDataset(out)) == 4
    return out


KILLED = """
import os, signal, sys
from pathlib import Path
from marssim import generate

def die():
    os.kill(os.getpid(), signal.SIGKILL)

def in_the_middle_of_an_image(path, data, whole=Path.write_bytes):
    if path.name != "depth.png":
        return whole(path, data)
    whole(path, data[: len(data) // 2])
    die()

def before_the_index_is_in_place(path, target, whole=Path.replace):
    return die() if Path(target).name == "dataset.json" else whole(path, target)

def when_a_scene_is_done(function, tasks, done, *more, whole=generate.run_tasks):
    whole(function, tasks, lambda *_: die(), *more)

if __name__ == "__main__":
    moment = globals()[sys.argv[1]]
    if moment is in_the_middle_of_an_image:
        Path.write_bytes = moment
    elif moment is before_the_index_is_in_place:
        Path.replace = moment
    else:
        generate.run_tasks = moment
    sys.exit(generate.main(sys.argv[2:]))
"""


def test_a_run_killed_at_any_moment_continues_to_the_same_bytes(undisturbed, tmp_path):
    """The command kills itself, so that the moment is the same in each run of the test."""
    out, program = tmp_path / "set", tmp_path / "killed.py"
    program.write_text(KILLED)
    moments = (
        ("in_the_middle_of_an_image", 0, "scenes/00000/.00.*.partial/depth.png"),
        ("when_a_scene_is_done", 2, "scenes/*/01/sample.json"),  # its two workers were at work
        ("before_the_index_is_in_place", 4, ".dataset.json.*.part"),
    )
    kept: dict[str, bytes] = {}
    for moment, least, left in moments:
        workers = ("--workers", "2") if moment == "when_a_scene_is_done" else ()
        ended = subprocess.run(  # returns once no worker holds the pipes any more, either
            [sys.executable, str(program), moment, "--out", str(out), *FLAGS, *workers], capture_output=True
        )
        assert ended.returncode == -signal.SIGKILL, ended.stderr.decode()
        complete = {str(s.parent.relative_to(out)): (s.parent / "left.png").read_bytes() for s in samples(out)}
        assert len(complete) >= least and list(out.glob(left))
        assert kept.items() <= complete.items() and not (out / "dataset.json").exists()
        kept = complete
    assert finish(out) == 0
    assert contents(out) == contents(undisturbed)


def test_a_disk_that_fills_up_names_the_place_and_harms_nothing(undisturbed, tmp_path):
    """The limit on the size of a file lets some, but not all, files of the first samples be written."""
    out = tmp_path / "set"
    sizes = [(undisturbed / "scenes/00000/00" / name).stat().st_size for name in ("left.png", "depth.png")]
    limit = max((undisturbed / "generate.json").stat().st_size, min(sizes)) + 100
    assert limit < max(p.stat().st_size for p in undisturbed.glob("scenes/00000/00/*"))

    def starve() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    one_scene = ["--pairs", "2", *FLAGS[2:]]  # so one worker, whatever their number
    asked = [sys.executable, "-m", "marssim.generate", "--out", str(out), *one_scene, "--workers", "2"]
    done = subprocess.run(asked, capture_output=True, text=True, preexec_fn=starve)
    line = error_line(done.returncode, done.stdout, done.stderr)
    assert line.startswith(f"error: --out {out}: {out}/scenes/") and "file too large" in line
    assert samples(out) == [] and not (out / "dataset.json").exists()
    assert finish(out) == 0
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


def test_a_full_disk_leaves_what_is_complete_and_goes_on_when_there_is_room(undisturbed, small_disk, tmp_path, capfd):
    line = refused(capfd, small_disk / "set")
    assert line.startswith(f"error: --out {small_disk / 'set'}: ") and "no space left on device" in line
    done = samples(small_disk / "set")
    assert 0 < len(done) < 4
    out = tmp_path / "set"
    shutil.copytree(small_disk / "set", out)
    assert finish(out) == 0
    assert contents(out) == contents(undisturbed)


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="no /proc here")
def test_a_folder_that_cannot_be_made_is_one_line(capfd):
    """Root may write into any folder of a disk, but not into /proc."""
    assert refused(capfd, Path("/proc/marssim-set")).startswith("error: --out /proc/marssim-set: ")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_an_unwritable_folder_is_one_line(tmp_path, capfd):
    tmp_path.chmod(0o555)
    assert refused(capfd, tmp_path / "set") == f"error: --out {tmp_path / 'set'}: permission denied"


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


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="reads Linux's /proc")
def test_memory_does_not_grow_with_the_number_of_scenes(tmp_path):
    """One process that renders scene after scene, as a worker does until it is replaced.

    What it holds after each, not its peak: that of a child begins at what its parent held.
    """
    program = """
import os, sys
from pathlib import Path
from marssim.base.files.json_file import as_json, write_json
from marssim.generation.config import parse_generate
from marssim.generation.scene_views import generate_scene
config = parse_generate("generate", None, sys.argv[1:])
config.out.mkdir()
write_json(config.out / "generate.json", as_json(config.content()))
for scene in range(12):
    generate_scene(config, scene, [0])
    print(int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6)
"""
    flags = ["--out", str(tmp_path / "set"), *FLAGS, "--no-trajectory"]
    done = subprocess.run([sys.executable, "-c", program, *flags], capture_output=True, text=True, check=True)
    held = [float(line) for line in done.stdout.split()]
    # [MB]; until then tiles and shapes are made that all scenes share. A renderer that is kept takes 15 to 20
    assert len(held) == 12 and held[-1] - held[7] < 30, held
