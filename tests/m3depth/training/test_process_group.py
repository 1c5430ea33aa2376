"""Processes that train together."""

import datetime

import pytest
import torch

from m3depth.training import process_group
from m3depth.training.process_group import joined_group


@pytest.mark.parametrize("rank", [0, 1])
def test_processes_wait_for_a_validation_of_hours(monkeypatch, rank) -> None:
    """The others wait in a collective while the first one validates; gloo alone would end them after 30 min."""
    called = []
    monkeypatch.setenv("LOCAL_RANK", str(rank))
    for name, value in (
        ("is_initialized", False), ("get_rank", rank), ("get_world_size", 2), ("barrier", None),
        ("destroy_process_group", None),
    ):  # fmt: skip
        monkeypatch.setattr(f"torch.distributed.{name}", lambda value=value: value)
    monkeypatch.setattr("torch.distributed.init_process_group", lambda *given, **named: called.append((given, named)))
    with joined_group("cpu") as (found, world, device):
        assert (found, world, device.type) == (rank, 2, "cpu")
    ((given, named),) = called
    assert given == ("gloo",) and named["timeout"] >= datetime.timedelta(hours=12)


@pytest.mark.parametrize(("kind", "left"), [("cpu", 1), ("cuda", 0)])
def test_a_process_that_fails_waits_for_the_others_on_no_gpu(monkeypatch, kind, left) -> None:
    """They wait for it in a collective, and NCCL ends a group only together: the process has to end as it is."""
    called = []
    monkeypatch.setenv("LOCAL_RANK", "0")
    monkeypatch.setattr(process_group, "chosen_device", lambda *_: torch.device(kind))
    monkeypatch.setattr("torch.cuda.set_device", lambda _: None)
    for name in ("init_process_group", "destroy_process_group", "barrier"):
        monkeypatch.setattr(f"torch.distributed.{name}", lambda *_, name=name, **__: called.append(name))
    for name, value in (("is_initialized", False), ("get_rank", 0), ("get_world_size", 2)):
        monkeypatch.setattr(f"torch.distributed.{name}", lambda value=value: value)
    with pytest.raises(OSError, match="full"), joined_group("auto"):
        raise OSError("full")
    assert called == ["init_process_group", *["destroy_process_group"] * left]
