import os
import shutil

import numpy as np
import pytest

from marssim.base.compute import kept_arrays as module
from marssim.base.compute.kept_arrays import kept_arrays
from marssim.scene.rocks.shape_library import draw_library

MADE = {
    "a": np.arange(12.0).reshape(3, 4),
    "b": np.array([], np.int8),
    "c": np.asfortranarray(np.eye(3, 2, dtype="<f4")),
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The folder of kernels, and a list that gets a word each time the arrays are made."""
    monkeypatch.setattr("numba.core.config.CACHE_DIR", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def arrays(folder):
    made = []

    def make():
        made.append("made")
        return MADE

    def get(name="mine"):
        return kept_arrays(draw_library, name, make), len(made)

    return get


def same(arrays):
    return arrays.keys() == MADE.keys() and all(
        a.dtype == MADE[k].dtype and a.flags.f_contiguous == MADE[k].flags.f_contiguous and np.array_equal(a, MADE[k])
        for k, a in arrays.items()
    )


def test_arrays_are_made_once_and_come_back_as_they_are(arrays, folder):
    for _ in range(3):
        values, times = arrays()
        assert same(values) and times == 1
    assert same(arrays("other")[0]) and arrays("other")[1] == 2
    assert sorted(file.name for file in folder.rglob("*") if file.is_file()) == ["mine.npz", "other.npz"]


@pytest.mark.parametrize("place", [0.0, 0.3, 0.6, 0.95])
@pytest.mark.parametrize("damage", ["cut", "flipped", "zeros"])
def test_a_damaged_file_is_made_again(arrays, folder, place, damage):
    arrays()
    (file,) = folder.rglob("*.npz")
    data = bytearray(file.read_bytes())
    at = int(place * len(data))
    if damage == "cut":
        del data[at:]
    elif damage == "flipped":
        data[at] ^= 0xFF
    else:
        data[at : at + 40] = bytes(len(data[at : at + 40]))
    file.write_bytes(data)
    assert same(arrays()[0]) and same(arrays()[0]) and arrays()[1] <= 2


def test_no_flipped_bit_of_the_directory_of_a_file_ends_a_process(arrays, folder):
    arrays()
    (file,) = folder.rglob("*.npz")
    whole = file.read_bytes()
    for at in range(whole.index(b"PK\x01\x02"), len(whole)):
        for bit in range(8):
            data = bytearray(whole)
            data[at] ^= 1 << bit
            file.write_bytes(data)
            assert same(arrays()[0])


def test_other_sources_processors_and_instructions_have_arrays_of_their_own(arrays, monkeypatch):
    arrays()
    monkeypatch.setenv("OPENBLAS_CORETYPE", "Haswell")
    assert arrays()[1] == 2 and arrays()[1] == 2
    monkeypatch.setattr(module.llvmlite.binding, "get_host_cpu_name", lambda: "z80")
    assert arrays()[1] == 3
    monkeypatch.setattr(module, "folder_digest", lambda folder: b"changed")
    assert arrays()[1] == 4
    for number, name in enumerate(module.PACKAGES, start=5):
        monkeypatch.setattr(module, "version", lambda package, name=name: "new" if package == name else "old")
        assert arrays()[1] == number and arrays()[1] == number


def test_a_package_without_metadata_is_no_error(arrays, monkeypatch):
    def missing(package):
        raise module.PackageNotFoundError(package)

    monkeypatch.setattr(module, "version", missing)
    assert same(arrays()[0]) and arrays()[1] == 1


def test_without_a_folder_to_write_the_arrays_are_made(arrays, folder, monkeypatch):
    monkeypatch.setattr(module, "write_atomically", lambda path, data: (_ for _ in ()).throw(OSError("full")))
    assert same(arrays()[0]) and arrays()[1] == 2 and not list(folder.rglob("*.npz"))

    def no_folder(owner):
        raise RuntimeError("cannot cache function: no locator available")

    monkeypatch.setattr(module, "FunctionCache", no_folder)
    assert same(arrays()[0]) and arrays()[1] == 4


def test_a_pickle_in_its_place_is_not_run(arrays, folder):
    arrays()
    (file,) = folder.rglob("*.npz")

    class Payload:
        def __reduce__(self):
            return os.mkdir, (str(folder / "run"),)

    np.savez(file.with_suffix(""), stamp=np.array([Payload()], object), a=np.array([Payload()], object))
    assert same(arrays()[0]) and not (folder / "run").exists()
    shutil.rmtree(folder)
    assert same(arrays()[0])
