import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import torch
from small_network import SMALL

from envs.world import loaded_methods
from envs.world.loaded_methods import loaded_method
from m3depth.network.model import M3Depth
from m3depth.weights import SHIPPED_WEIGHTS
from marssim.base.camera import NATECAM


@pytest.fixture(autouse=True)
def nothing_loaded(monkeypatch):
    monkeypatch.setattr(loaded_methods, "_LOADED", {})


def saved(seed, path):
    torch.manual_seed(seed)
    M3Depth(SMALL).save_pretrained(path)


def test_a_network_is_loaded_once(monkeypatch):
    loads, load = [], loaded_methods.load_perception
    monkeypatch.setattr(loaded_methods, "load_perception", lambda *named: loads.append(named) or load(*named))
    names = ("m3depth", f"m3depth:{SHIPPED_WEIGHTS}", "sgbm", "ground_truth")
    one, two = ([loaded_method(name, "pytorch") for name in names] for _ in range(2))
    assert all(a is b for a, b in zip(one, two)) and loads == [(name, "pytorch") for name in names]


def test_weights_that_were_written_again_are_loaded_again(tmp_path):
    """A worker of a cluster lives on while the network is trained further."""
    path, (left, right) = tmp_path / "weights.safetensors", np.random.default_rng(0).integers(256, size=(2, 64, 64, 3))
    pair = left.astype(np.uint8), right.astype(np.uint8), NATECAM.resized(64, 64)
    depths = []
    for seed in (1, 2, 2):
        saved(seed, path)
        depths.append(loaded_method(f"m3depth:{path}", "pytorch").infer(*pair).depth)
    assert not np.array_equal(depths[0], depths[1]) and np.array_equal(depths[1], depths[2])
    assert len(loaded_methods._LOADED) == 1


def test_missing_weights_name_the_argument(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"^`perception` .*none\.safetensors: no such weights file"):
        loaded_method(f"m3depth:{tmp_path / 'none.safetensors'}", "auto")


def test_a_class_that_can_begin_a_drive_serves_the_drives_of_one_thread(tmp_path, monkeypatch):
    """A worker of dask may drive in several threads at once."""
    (tmp_path / "beginning.py").write_text(
        "class Method:\n    def infer(self, left, right, rig): ...\n    def begin_drive(self): ...\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    loaded, done = threading.Event(), threading.Event()

    def of_first_thread():
        methods = [loaded_method("beginning:Method", "auto") for _ in range(2)]
        loaded.set()
        done.wait(20)  # or the pool would take this thread again
        return methods

    def of_second_thread():
        loaded.wait(20)
        method = loaded_method("beginning:Method", "auto")
        done.set()
        return method

    with ThreadPoolExecutor(2) as pool:
        first, second = pool.submit(of_first_thread), pool.submit(of_second_thread)
    (one, again), other = first.result(), second.result()
    assert one is again and one is not other


def test_a_class_that_can_begin_a_drive_is_made_again_for_another_checkpoint(tmp_path, monkeypatch):
    (tmp_path / "reading.py").write_text(
        "class Method:\n    files = 'checkpoint'\n"
        "    def __init__(self):\n        self.read = open('checkpoint').read()\n"
        "    def infer(self, left, right, rig): ...\n    def begin_drive(self): ...\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.chdir(tmp_path)
    for content in ("first", "second"):
        (tmp_path / "checkpoint").write_text(content)
        assert loaded_method("reading:Method", "auto").read == content
