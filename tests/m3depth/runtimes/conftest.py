"""Small networks of the two kinds, and OpenVINO with a folder for its graphs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import pytest
import torch
from small_network import SMALL

from m3depth.network.model import M3Depth


@pytest.fixture(scope="session")
def small_network() -> Callable[..., M3Depth]:
    """A network with random weights whose every part matters; arguments replace sizes of SMALL."""

    def make(**sizes: object) -> M3Depth:
        torch.manual_seed(1)
        network = M3Depth(replace(SMALL, **{"finer_steps": 2, **sizes})).eval()  # each step is converted again
        with torch.no_grad():
            for parameter in network.parameters():  # some begin as zeros, which leave their part out
                parameter.add_(0.02 * torch.randn_like(parameter))
        return network

    return make


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    """OpenVINO is installed."""
    pytest.importorskip("m3depth.runtimes.openvino_import", reason="OpenVINO is not installed")
    monkeypatch.setattr("m3depth.runtimes.choice.openvino_is_installed", lambda: True)


@pytest.fixture(scope="module")
def graphs_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A folder for graphs that this module's tests share, so that each is converted once."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield
