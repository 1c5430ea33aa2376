"""Graphs on disk."""

import os
from dataclasses import replace

import numpy as np
import pytest
import torch

pytest.importorskip("m3depth.runtimes.openvino_import", reason="OpenVINO is not installed")
from m3depth.network.model import M3Depth
from m3depth.runtimes.graph_files import KEPT, cache_folder, graph_name, kept
from m3depth.runtimes.graphs import packed, unpacked
from m3depth.runtimes.openvino_import import openvino


@pytest.fixture(scope="module")
def graph():
    """A packed graph of few operations, with three inputs."""
    opset = openvino.opset13
    inputs = [opset.parameter([1, 3, 8, 8], np.float32) for _ in range(3)]
    weights = opset.constant(np.random.default_rng(0).normal(size=(64, 3, 3, 3)).astype(np.float32))
    convolution = opset.convolution(
        opset.add(inputs[0], opset.add(*inputs[1:])), weights, [1, 1], [0, 0], [0, 0], [1, 1]
    )
    return packed(openvino.Model([convolution], inputs, "few"))


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """An empty folder of graphs."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "mars-m3depth"


class Counter:
    """Returns a graph, and counts how often it was asked for."""

    def __init__(self, data):
        self.data, self.calls = data, 0

    def __call__(self):
        self.calls += 1
        return self.data


def test_a_graph_is_converted_once(graph, folder):
    convert = Counter(graph)
    for _ in range(2):
        assert len(kept("one", convert).inputs) == 3
    assert convert.calls == 1 and [file.name for file in folder.iterdir()] == ["one.zip"]


@pytest.mark.parametrize("damage", [lambda data: b"", lambda data: data[: len(data) // 2], lambda data: b"x" * 999])
def test_a_damaged_file_is_replaced(graph, folder, damage):
    folder.mkdir()
    (folder / "one.zip").write_bytes(damage(graph))
    convert = Counter(graph)
    assert len(kept("one", convert).inputs) == 3
    assert convert.calls == 1 and (folder / "one.zip").read_bytes() == graph


def test_a_changed_byte_is_noticed(graph):
    middle = len(graph) // 2
    with pytest.raises(ValueError, match="cannot be read"):
        unpacked(graph[:middle] + bytes([graph[middle] ^ 255]) + graph[middle + 1 :])


def test_where_nothing_can_be_written_each_process_converts(graph, folder):
    folder.write_text("a file in the way")
    convert = Counter(graph)
    for _ in range(2):
        assert len(kept("one", convert).inputs) == 3
    assert convert.calls == 2


def test_the_files_unused_for_longest_are_deleted(graph, folder):
    folder.mkdir()
    for number in range(KEPT + 3):
        file = folder / f"{number:02d}.zip"
        file.write_bytes(graph)
        os.utime(file, (number, number))
    kept("00", Counter(graph))  # used now
    kept("new", Counter(graph))
    names = {file.stem for file in folder.iterdir()}
    assert len(names) == KEPT and {"00", "new"} <= names and "01" not in names


def test_names_differ_by_all_that_a_graph_depends_on(small_network):
    network = small_network()
    names = [graph_name(network, finer, dtype) for finer in (False, True) for dtype in (torch.float32, torch.bfloat16)]
    assert graph_name(small_network(), False, torch.float32) == names[0]
    names.append(graph_name(M3Depth(replace(network.config, finer_steps=7)), False, torch.float32))
    with torch.no_grad():
        next(network.parameters()).add_(1e-3)
    names.append(graph_name(network, False, torch.float32))
    assert len(set(names)) == len(names) == 6


def test_the_folder_is_the_users(monkeypatch, tmp_path):
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cache_folder() == tmp_path / ".cache" / "mars-m3depth"
