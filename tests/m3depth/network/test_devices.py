"""Networks on another device than the processor: PyTorch's meta device, which adds no tensors of two devices."""

from collections.abc import Iterator
from contextlib import nullcontext

import pytest
import torch
from small_network import SMALL
from small_rivals import TINY

from m3depth.kinds.networks import new_network
from m3depth.network.device import chosen_device


def tensors(value) -> Iterator[torch.Tensor]:
    """Yield the tensors in an output, also those in its lists and tuples."""
    if isinstance(value, torch.Tensor):
        yield value
    elif isinstance(value, list | tuple):
        for item in value:
            yield from tensors(item)
    elif hasattr(value, "__dict__"):
        yield from tensors([*vars(value).values()])


@pytest.mark.parametrize("name", ["m3depth", *TINY])
def test_all_that_a_network_computes_stays_on_its_device(name, monkeypatch) -> None:
    monkeypatch.setattr(torch, "autocast", lambda *_, **__: nullcontext())  # which has no such device
    network = new_network(SMALL if name == "m3depth" else TINY[name]).eval().to("meta")
    size = (2, 3, 64, 128)
    inputs = [torch.empty(size, device="meta"), torch.empty(size, device="meta"), torch.empty(2, 4, device="meta")]
    with torch.inference_mode():
        output = network(*inputs)
    maps = [*tensors(output)]
    assert maps and all(value.device.type == "meta" for value in maps)


def test_a_process_that_was_forked_beside_a_gpu_says_how_to_start_it(monkeypatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 1)
    monkeypatch.setattr(torch.cuda, "_is_in_bad_fork", lambda: True)
    with pytest.raises(ValueError, match="'context': 'spawn'"):
        chosen_device("auto")
    assert chosen_device("cpu").type == "cpu"
