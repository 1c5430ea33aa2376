"""Processes that train together."""

import datetime

import pytest

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
