import os
import pickle
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest
from numba import typeof

import marssim
from marssim.base.command.run import exit_code
from marssim.base.compute.compiled import KEPT, NOT_KEPT, compiled, compiled_in_place, folder_digest, inlined, read_only

KERNELS = """
from some.steps import STEP
from marssim.base.compute.compiled import compiled

@compiled
def up(x):
    return x + STEP

print(up(1), sum(up.stats.cache_hits.values()))
"""


COMMAND = """
import sys
from marssim.base.command.run import exit_code
from marssim.base.compute.compiled import compiled
from marssim.base.compute.workers import run_tasks

@compiled
def up(x):
    return x + 1

@compiled
def down(x):
    return x - 1

@compiled
def same(x):
    return x

def work(x):
    return up(x) + down(x) + (same(0) if sys.argv[2:] else 0)

if __name__ == "__main__":
    from some.work import work  # as the workers know it
    workers = int(sys.argv[1])
    sys.exit(exit_code(lambda: run_tasks(work, [(n,) for n in range(4)], lambda task, result: print(result), workers)))
"""


def run(folder: Path, **environment: str) -> list[int]:
    """What the package prints: the kernel's answer, and how many kernels came from disk."""
    done = subprocess.run(
        [sys.executable, "-c", "import some.kernels"], cwd=folder, capture_output=True, text=True,
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1", **environment},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return [int(word) for word in done.stdout.split()]


def package(folder: Path, step: int) -> None:
    made = folder / "some"
    made.mkdir(exist_ok=True)
    (made / "__init__.py").touch()
    (made / "steps.py").write_text(f"STEP = {step}\n")
    (made / "kernels.py").write_text(KERNELS)


def test_kernels_are_kept_until_any_source_of_their_package_or_of_this_one_changes(tmp_path):
    """Those of another package may be built from parts of this one."""
    package(tmp_path, 10)
    copied = shutil.copytree(Path(marssim.__file__).parent, tmp_path / "marssim")
    cache = {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    assert run(tmp_path, **cache) == [11, 0]
    assert run(tmp_path, **cache) == [11, 1]
    package(tmp_path, 20)  # another file than the kernel's
    assert run(tmp_path, **cache) == [21, 0]
    with (copied / "scene" / "look.py").open("a") as file:
        file.write("# changed\n")
    assert run(tmp_path, **cache) == [21, 0]


DAMAGES = {
    "empty": lambda data: b"",
    "broken": lambda data: b"\x80\x04\x95\x00",
    "foreign": lambda data: b"cmarssim.base.nowhere\nNothing\n.",
    # as a disk may leave it after a power loss: whole by its length, with zeros in the machine code
    **{
        f"zeros{n}": lambda data, at=share: zeroed(data, int(at * len(data))) for n, share in enumerate((0.3, 0.6, 0.9))
    },
}
MANY_KERNELS = "from marssim.base.compute.compiled import compiled\n\n" + "".join(
    f"""
@compiled
def {name}(x):
    return x + {n}
"""
    for n, name in enumerate(
        ["whole", *(f"{damage}_nbi" for damage in list(DAMAGES)[:3]), *(f"{damage}_nbc" for damage in DAMAGES)]
    )
)


def zeroed(data: bytes, at: int) -> bytes:
    return data[:at] + bytes(64) + data[at + 64 :]


def test_kernels_whose_files_cannot_be_read_are_compiled_again(tmp_path):
    names = re.findall(r"def (\w+)", MANY_KERNELS)
    asks = "\nprint(*(kernel(1) for kernel in (NAMES)), *(sum(kernel.stats.cache_hits.values()) for kernel in (NAMES)))"
    package(tmp_path, 10)
    (tmp_path / "some" / "kernels.py").write_text(MANY_KERNELS + asks.replace("NAMES", ", ".join(names)))
    cache, answers = {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}, [1 + n for n in range(len(names))]
    assert run(tmp_path, **cache) == [*answers, *(0 for _ in names)]
    for name in names[1:]:
        damage, kind = name.split("_")
        (file,) = (tmp_path / "cache").rglob(f"*.{name}-*.{kind}")
        version = pickle.dumps(numba.__version__) if kind == "nbi" else b""
        file.write_bytes(version + DAMAGES[damage](file.read_bytes()))
    assert run(tmp_path, **cache) == [*answers, 1, *(0 for _ in names[1:])]
    assert run(tmp_path, **cache) == [*answers, *(1 for _ in names)]


def test_kernels_run_where_nothing_can_be_kept(tmp_path):
    package(tmp_path, 10)
    nowhere = tmp_path / "file"
    nowhere.touch()
    assert run(tmp_path, NUMBA_CACHE_DIR=str(nowhere / "cache")) == [11, 0]


@pytest.fixture
def homeless(monkeypatch):
    """No folder in which kernels could be kept."""

    def refuse(*_: object) -> None:
        raise RuntimeError("cannot cache function: no locator available")

    monkeypatch.setattr("numba.core.caching.CompileResultCacheImpl.__init__", refuse)


def test_without_a_folder_to_write_a_kernel_is_compiled_anew(homeless):
    assert compiled(lambda x: 2 * x)(np.arange(3)).tolist() == [0, 2, 4]


@pytest.mark.parametrize("workers", [1, 2])
def test_a_command_tells_once_that_it_compiles(workers, tmp_path):
    """By whichever process, for whichever kernel; not when they are kept, nor when a later run needs one more. Workers
    need one more in the second run.
    """
    package(tmp_path, 10)
    (tmp_path / "some" / "work.py").write_text(COMMAND)
    notes = []
    for more in ([], [], ["one more"]) if workers == 1 else ([], ["one more"]):
        done = subprocess.run(
            [sys.executable, "-m", "some.work", str(workers), *more], cwd=tmp_path, capture_output=True, text=True,
            env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONDONTWRITEBYTECODE": "1"},
        )  # fmt: skip
        assert done.returncode == 0 and sorted(done.stdout.split()) == ["0", "2", "4", "6"], done.stderr
        notes.append(done.stderr)
    assert notes[0] == f"note: {KEPT}\n" and not any(notes[1:])


def test_a_command_tells_that_nothing_can_be_kept(homeless, capsys):
    kernels = [compiled(lambda x: 2 * x), compiled(lambda x: 3 * x)]
    assert exit_code(lambda: [kernel(1) for kernel in kernels]) == 0
    assert capsys.readouterr().err == f"note: {NOT_KEPT}\n"
    assert compiled(lambda x: 4 * x)(1) == 4  # a program's own call
    assert capsys.readouterr().err == ""


@inlined
def half(x):
    return x / 2


def test_a_kernel_in_place_fills_its_arrays():
    @compiled_in_place
    def double(values, out):
        for k in range(len(values)):
            out[k] = 2 * values[k]

    out = np.zeros(3)
    double(np.arange(3.0), out)
    assert out.tolist() == [0, 2, 4]
    assert "NRT_incref" not in next(iter(double.inspect_llvm().values()))


def test_parts_of_kernels_call_each_other():
    @inlined
    def quarter(x):
        return half(half(x))

    assert compiled(lambda x: quarter(x) + half(x))(3.0) == 2.25


def test_a_part_of_kernels_is_not_called_from_python():
    with pytest.raises(TypeError, match="half is a part of compiled kernels"):
        half(3.0)
    assert half.py_func(3.0) == 1.5


@pytest.mark.parametrize("writable", [True, False])
@pytest.mark.parametrize("values", [np.eye(4), np.eye(4)[::2, 1:], np.eye(4, dtype=np.float32), np.eye(4).T])
def test_arrays_of_any_kind_have_one_type_in_kernels(values, writable):
    before = values.copy()
    values = values.copy() if writable else values
    values.setflags(write=writable)
    assert str(typeof(read_only(values))) == str(typeof(read_only(np.eye(2))))
    assert np.array_equal(read_only(values), before) and values.flags.writeable == writable


def test_the_digest_sees_names_and_contents(tmp_path):
    (tmp_path / "a.py").write_text("x = 1")
    first = folder_digest.__wrapped__(tmp_path)
    (tmp_path / "a.py").write_text("x = 2")
    second = folder_digest.__wrapped__(tmp_path)
    (tmp_path / "a.py").rename(tmp_path / "b.py")
    assert len({first, second, folder_digest.__wrapped__(tmp_path)}) == 3
