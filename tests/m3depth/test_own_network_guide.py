"""The program of docs/guides/rivals.md does what the page says."""

import importlib
import sys
from dataclasses import dataclass
from types import ModuleType, SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest
import torch

from m3depth.estimator import EstimatorName, load_estimator
from m3depth.kinds.networks import CLASSES, add_network, new_network
from m3depth.rivals.config import CONFIGS, SOURCES, RaftStereoConfig, RivalConfig
from m3depth.rivals.output import SequenceOutput
from m3depth.rivals.raft_stereo import RaftStereo
from m3depth.train import main

pytestmark = pytest.mark.usefixtures("undrawn_figures")


@pytest.fixture
def my_network(tmp_path, monkeypatch, guide_program):
    (tmp_path / "my_network.py").write_text(guide_program("my_network.py"))
    monkeypatch.syspath_prepend(str(tmp_path))
    yield importlib.import_module("my_network")
    del sys.modules["my_network"]
    CLASSES.pop(CONFIGS.pop("plain", None), None)
    SOURCES.pop("plain", None)


def test_a_network_of_the_user_is_trained_and_its_weights_are_read(
    my_network, plane_set, plane_samples, tmp_path, capsys
):
    (tmp_path / "plain.json").write_text('{"kind": "plain", "width": 4}')
    flags = ["--data", str(plane_set), "--out", str(tmp_path / "run"), "--network", str(tmp_path / "plain.json")]
    assert main([*flags, "--max-steps", "2", "--batch", "1", "--crop", "32", "64", "--device", "cpu"]) == 0
    assert "\nscore them: call m3depth.evaluate.main in a program that adds" in capsys.readouterr().out
    add_network(my_network.PlainConfig, my_network.Plain)  # as a cell of a notebook that is run again
    name = f"m3depth:{tmp_path / 'run/weights.safetensors'}"
    network = load_estimator(name)
    assert isinstance(network, my_network.Plain) and network.config == my_network.PlainConfig(4)
    sample = plane_samples[0]
    assert np.isfinite(network.infer(sample.left, sample.right, sample.rig).disparity).all()
    before = EstimatorName.parse(name).digest()
    source = tmp_path / "my_network.py"
    source.write_text(source.read_text().replace("50 *", "30 *"))
    assert EstimatorName.parse(name).digest() != before  # nothing goes on with another network of the same weights
    CLASSES.pop(CONFIGS.pop("plain"))  # as for a command by its own name
    assert main([*flags, "--max-steps", "3", "--batch", "1", "--init", str(tmp_path / "run/weights.safetensors")]) == 2
    told = capsys.readouterr().err
    assert "checkpoint.pt: network config: kind 'plain' is not one of" in told and "which calls add_network" in told


def test_what_a_network_of_ones_own_returns_is_checked(my_network, monkeypatch):
    network = my_network.Plain(my_network.PlainConfig(4))
    images, camera = torch.rand(2, 3, 32, 64), torch.tensor([[50.0, 50.0, 32.0, 16.0]] * 2)
    right = torch.full((2, 1, 32, 64), 3.0)
    assert network(images, images, camera).disparity.shape == right.shape
    for output, message in (
        (SequenceOutput([], []), "maps must be a list of one map or more, got list"),
        (SequenceOutput([right], [0.5, 1]), "shares must be as many numbers as there are maps, 1"),
        (SequenceOutput(right, [1, 1]), "maps must be a list of one map or more, got Tensor"),
        (SequenceOutput([None, right], [0.5, 1]), "disparities must be tensors, got NoneType"),
        (SimpleNamespace(disparity=right), "must return an output of m3depth.rivals.output, got SimpleNamespace"),
        (right, "must return an output of m3depth.rivals.output, got Tensor"),
        (SequenceOutput([right, right[:, 0]], [1, 1]), r"must have the shape \(2, 1, 32, 64\), got \(2, 32, 64\)"),
        (SequenceOutput([right[..., ::2], right], [1, 1]), r"the shape \(2, 1, 32, 64\), got \(2, 1, 32, 32\)"),
        (SequenceOutput([right.bfloat16()], [1]), "must be float32, got bfloat16, which would round them"),
    ):
        monkeypatch.setattr(my_network.Plain, "estimate", lambda *_, output=output: output)
        with pytest.raises(ValueError, match=f"^Plain.estimate:? .*{message}"):
            network(images, images, camera)
    monkeypatch.setattr(my_network.Plain, "__init__", lambda self, config: super(my_network.Plain, self).__init__())
    with pytest.raises(ValueError, match=r"^Plain: must keep its sizes as self\.config$"):
        new_network(my_network.PlainConfig(4))


@dataclass(frozen=True)
class SameName(RivalConfig):
    KIND: ClassVar[str] = "raft-stereo"


@dataclass(frozen=True)
class WithoutName(RivalConfig):
    width: int = 1


class NoDataclass(RivalConfig):
    KIND: ClassVar[str] = "none"
    width: int = 1


@dataclass(frozen=True)
class Sizes(RivalConfig):
    KIND: ClassVar[str] = "sizes"
    dropout: float = 0.1
    depths: tuple[int, ...] = (1, 2)
    rates: tuple[float, float] = (0.5, 1.0)
    name: str = "a"


def test_sizes_of_several_kinds_come_back_from_a_file():
    sizes = Sizes(0.0, (3, 4, 5), (1.0, 2.0), "b")
    assert Sizes.from_dict({"dropout": 0, "depths": [3, 4, 5], "rates": [1, 2], "name": "b"}) == sizes
    for name, value in (("rates", [1.0]), ("depths", [0.5]), ("dropout", "x"), ("dropout", float("inf"))):
        with pytest.raises(ValueError, match=f"^network config: field '{name}' has the value"):
            Sizes.from_dict({name: value})
    for depths, message in (((), "^depths must be a number"), ((0,), "^depths must be at least 1")):
        with pytest.raises(ValueError, match=message):
            Sizes(depths=depths)


@dataclass(frozen=True)
class WithoutDefault(RivalConfig):
    KIND: ClassVar[str] = "without"
    width: int


@dataclass(frozen=True)
class WithNone(RivalConfig):
    KIND: ClassVar[str] = "with-none"
    radius: int | None = None


@dataclass(frozen=True)
class OtherDefault(RivalConfig):
    """A file with a share of 0.5 would be refused, since the default is a whole number."""

    KIND: ClassVar[str] = "other"
    share: float = 1


def test_a_network_of_a_notebook_can_be_added(monkeypatch):
    module = ModuleType("__main__")  # without a file
    monkeypatch.setitem(sys.modules, "__main__", module)
    network = type("Cell", (RaftStereo,), {"__module__": "__main__"})
    monkeypatch.setitem(CLASSES, Sizes, network)
    monkeypatch.setitem(CONFIGS, "sizes", Sizes)
    add_network(Sizes, network)
    assert CLASSES[Sizes] is network and "sizes" not in SOURCES


def test_a_network_that_cannot_be_added_is_named():
    for config, network, message in (
        (SameName, RaftStereo, "^SameName: a network of this package has the kind 'raft-stereo'$"),
        (WithoutName, RaftStereo, r"^config must be a dataclass, .* with KIND as a text, got .*WithoutName"),
        (NoDataclass, RaftStereo, r"^config must be a dataclass, .*NoDataclass"),
        (
            WithoutDefault,
            RaftStereo,
            "^WithoutDefault: width must be declared as int, .* of this type, got none$",
        ),
        (WithNone, RaftStereo, "^WithNone: radius must be declared as int, .*, got None$"),
        (OtherDefault, RaftStereo, "^OtherDefault: share must be declared as int, .*, got 1$"),
        (RaftStereoConfig(), RaftStereo, r"^config must be a dataclass, .*got RaftStereoConfig\("),
        ("plain", RaftStereo, r"^config must be a dataclass, .*got 'plain'$"),
        (RaftStereoConfig, dict, "^network must be a subclass of StereoRival, got <class 'dict'>$"),
    ):
        with pytest.raises(ValueError, match=message):
            add_network(config, network)
    assert CLASSES[RaftStereoConfig] is RaftStereo
