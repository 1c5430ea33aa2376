"""A checkpoint that is damaged or forged is named in one line, before the run changes."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from small_network import SMALL

from m3depth.network import model as model_module
from m3depth.rivals.config import SOURCES
from m3depth.training.config import TrainConfig
from m3depth.training.run import Run, saved_progress

CPU = torch.device("cpu")
ACCELERATOR_ERROR = type("AcceleratorError", (RuntimeError,), {})("CUDA error: the device is busy")


@pytest.fixture
def run(tmp_path, monkeypatch) -> Run:
    """A run of one step, saved."""
    monkeypatch.setitem(model_module.PRESETS, "lite", SMALL)
    run = Run(TrainConfig(data=(Path("planes"),), out=tmp_path, max_steps=9, device="cpu"), CPU)
    sum(weight.square().sum() for weight in run.model.parameters()).backward()
    run.optimizer.step()
    run.step, run.seconds = 1, 2.5
    run.save()
    return run


def without(key):
    return lambda state: state.pop(key)


def put(value, *keys):
    """Return a change that replaces a value of nested dicts."""

    def change(state):
        for key in keys[:-1]:
            state = state[key]
        state[keys[-1]] = value

    return change


def test_what_was_saved_is_continued(run):
    again = Run(run.config, CPU)
    assert again.resume() and (again.step, again.seconds, again.changed) == (1, 2.5, [])
    for before, now in zip(run.optimizer.state.values(), again.optimizer.state.values(), strict=True):
        assert all(torch.equal(before[name], now[name]) for name in ("step", "exp_avg", "exp_avg_sq"))


def test_another_source_of_an_added_network_is_named(run, tmp_path, monkeypatch):
    source = tmp_path / "own.py"
    source.write_text("width = 1\n")
    monkeypatch.setitem(SOURCES, SMALL.KIND, source)
    before = Run(run.config, CPU)
    before.save()
    same = Run(run.config, CPU)
    assert same.resume() and same.changed == []
    source.write_text("width = 2\n")
    other = Run(run.config, CPU)
    assert other.resume() and other.changed == ["the source file of the network has changed"]
    monkeypatch.delitem(SOURCES, SMALL.KIND)  # a class of a notebook, whose source is unknown
    notebook = Run(run.config, CPU)
    assert notebook.resume() and notebook.changed == []
    monkeypatch.setitem(SOURCES, SMALL.KIND, source)
    state = torch.load(run.checkpoint, weights_only=True)
    state["model"].popitem()  # as of a class that had a layer less
    torch.save(state, run.checkpoint)
    with pytest.raises(ValueError, match=r"checkpoint.pt: does not fit the network, whose source file has changed"):
        Run(run.config, CPU).resume()


@pytest.mark.parametrize(
    "change",
    [
        *map(without, ("identity", "model", "averaged", "optimizer", "step", "seconds", "rng")),
        put("one", "step"), put(-1, "step"), put(10**40, "step"), put(True, "step"), put(float("nan"), "seconds"),
        put("long", "seconds"), put({}, "model"), put([1, 2], "model"), put(torch.zeros(3), "rng"), put(1, "settings"),
        put({"weight": torch.zeros(2)}, "averaged"), put([], "optimizer"), put({0: {}}, "optimizer", "state"),
        put(torch.zeros(1), "optimizer", "state", 0, "exp_avg"), put("four", "optimizer", "state", 0, "step"),
        put({"step": torch.tensor(1.0)}, "optimizer", "state", 9999),
    ],
)  # fmt: skip
def test_a_checkpoint_with_other_content_is_named(run, change):
    state = torch.load(run.checkpoint, weights_only=True)
    change(state)
    torch.save(state, run.checkpoint)
    with pytest.raises(ValueError, match=r"checkpoint\.pt: not a readable checkpoint \(\w+\); delete it to") as error:
        Run(run.config, CPU).resume()
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("error", [MemoryError(), torch.OutOfMemoryError("CUDA out of memory."), ACCELERATOR_ERROR])
def test_a_checkpoint_that_finds_no_memory_is_not_called_damaged(run, error, monkeypatch):
    """Its user would delete it."""

    def full(*_, **__):
        raise error

    monkeypatch.setattr(torch, "load", full)
    with pytest.raises(type(error)):
        Run(run.config, CPU).resume()


def test_the_settings_of_the_optimizer_are_those_of_the_command(run):
    """A checkpoint gives it what it keeps of the weights, and nothing else."""
    state = torch.load(run.checkpoint, weights_only=True)
    state["optimizer"]["param_groups"] = [{"betas": "none", "lr": float("inf"), "params": [0]}]
    torch.save(state, run.checkpoint)
    again = Run(run.config, CPU)
    assert again.resume()
    (group,) = again.optimizer.param_groups
    assert (group["betas"], group["lr"], group["weight_decay"]) == ((0.9, 0.999), 8e-4, 1e-4)


def test_the_progress_of_a_run_is_read_from_its_checkpoint(run, tmp_path):
    assert saved_progress(tmp_path) == (1, 2.5) and saved_progress(tmp_path / "none") == (0, 0.0)


@pytest.mark.parametrize(("step", "share"), [(0, 0.9), (10**6, 0.01)])
def test_the_average_moves_towards_the_weights_fast_at_first_and_slowly_later(run, step, share):
    run.config, run.step = replace(run.config, ema=0.99), step
    before = [average.clone() for average in run.averaged.parameters()]
    with torch.no_grad():
        for weight, average in zip(run.model.parameters(), before, strict=True):
            weight.copy_(average + 1)
    run.average()
    for average, then in zip(run.averaged.parameters(), before, strict=True):
        torch.testing.assert_close(average - then, torch.full_like(then, share), atol=1e-4, rtol=1e-3)
