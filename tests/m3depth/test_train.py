import json
import math
import os
import re
import shlex
import shutil
import signal
from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace
from typing import ClassVar

import cv2
import pytest
import torch
from small_network import SMALL
from small_rivals import TINY

from m3depth.datasets.config import DataConfig
from m3depth.evaluate import EvaluateOptions
from m3depth.kinds.networks import new_network
from m3depth.network import model as model_module
from m3depth.network.model import M3Depth
from m3depth.rivals.config import PRESETS
from m3depth.train import main
from m3depth.training import run as run_module
from m3depth.training.config import TrainConfig
from m3depth.training.log import records
from m3depth.training.loop import Validator, backward, finer_losses, one_step, train
from m3depth.training.loss_config import LossConfig
from m3depth.training.losses import total_loss
from m3depth.training.messages import announce, summary
from m3depth.training.packing import pack
from m3depth.training.run import Run, learning_rate, saved_progress
from m3depth.training.samples import JoinedPairs, PackedCache, make_batch
from m3depth.training.validation import validate
from m3depth.weights import SHIPPED_WEIGHTS
from marssim.base.command.flags import parse
from marssim.base.files.json_file import DatasetError
from marssim.base.results import lock
from marssim.base.results.lock import FolderInUse


@pytest.fixture(autouse=True)
def small_network(monkeypatch):
    monkeypatch.setitem(model_module.PRESETS, "lite", SMALL)
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.fixture(autouse=True)
def few_figures(request) -> None:
    """Only the tests that are about pictures draw them: each training ends with one, which takes half a second."""
    about_pictures = (
        test_training_lowers_the_errors_and_writes_what_it_says, test_tensorboard_holds_curves_and_panels,
        test_a_run_draws_its_curves_and_names_the_picture, test_curves_are_drawn_at_validations_and_at_the_end,
    )  # fmt: skip
    if request.function not in about_pictures:
        request.getfixturevalue("undrawn_figures")


def config_for(out: Path, **changes) -> TrainConfig:
    base = TrainConfig(
        data=(Path("planes"),), out=out, batch=2, crop=(32, 64), max_steps=10, lr=5e-3, validate_samples=1, device="cpu"
    )
    return replace(base, **changes)


def losses_of(out: Path) -> list[float]:
    records = [json.loads(line) for line in (out / "log.jsonl").read_text().splitlines()]
    return [r["loss"] for r in records if r["kind"] == "train"]


@pytest.mark.parametrize(("crop", "padded"), [((32, 64), None), ((40, 64), "48 x 64"), ((64, 72), "64 x 80")])
def test_crops_that_the_network_pads_are_a_warning(tmp_path, capsys, crop, padded) -> None:
    run = Run(config_for(tmp_path, crop=crop), torch.device("cpu"))
    assert run.model.size_multiple == 16
    announce(run, False, 3, 1)
    error = capsys.readouterr().err
    warning = f"warning: --crop {crop[0]} {crop[1]}: the network pads these crops to {padded} px, and errs at"
    assert (warning in error) == (padded is not None) and ("warning" in error) == (padded is not None)


def test_training_lowers_the_errors_and_writes_what_it_says(plane_samples, tmp_path) -> None:
    config, cpu = config_for(tmp_path, max_steps=16), torch.device("cpu")
    (untrained,) = validate([Run(config, cpu).averaged], [pack(plane_samples[0])], cpu)
    threads = cv2.getNumThreads()
    cv2.setNumThreads(2)
    try:
        scores = train(config, plane_samples, plane_samples)
        assert cv2.getNumThreads() == 2  # as it was before
    finally:
        cv2.setNumThreads(threads)
    assert scores["epe"] < 0.7 * untrained["epe"] and scores["normal"] < 0.3 * untrained["normal"]
    assert losses_of(tmp_path)
    train_records, stops = records(tmp_path, "train"), records(tmp_path, "stop")
    assert [record["step"] for record in train_records] == [1, 10] and [record["step"] for record in stops] == [16]
    assert stops[0]["minutes"] > train_records[-1]["minutes"] > 0
    assert stops[0]["processor_minutes"] > train_records[-1]["processor_minutes"] > 0
    assert M3Depth.from_pretrained(tmp_path / "weights.safetensors").config == SMALL
    assert json.loads((tmp_path / "weights.json").read_text())["hidden"] == 8
    assert list((tmp_path / "panels").glob("*.png"))


def test_the_refinement_of_larger_pairs_is_trained(large_samples, tmp_path) -> None:
    """From where the reduced pair ends, at full resolution: its errors fall, and the weights move by its loss alone."""
    config, cpu = config_for(tmp_path, max_steps=12), torch.device("cpu")
    (untrained,) = validate([Run(config, cpu).averaged], [pack(large_samples[0])], cpu)
    scores = train(config, large_samples, large_samples)
    assert scores["epe"] < 0.7 * untrained["epe"] and scores["normal"] < 0.3 * untrained["normal"]
    run = Run(config, cpu)
    batch = make_batch(PackedCache(large_samples, 0), 0, 2, config.crop, config.augment, config.seed)
    output = run.model(batch.left, batch.right, batch.target.camera)
    finer_losses(run.model, output, batch, config, None).sum().backward()
    moved = {name.partition(".")[0] for name, p in run.model.named_parameters() if p.grad is not None}
    assert moved == {"backbone", "refinement", "fine"}


class KilledAt:
    """Samples that send this process SIGTERM at the n-th reading."""

    def __init__(self, samples, reading: int) -> None:
        self.samples, self.left = samples, reading

    def __len__(self) -> int:
        return len(self.samples)

    def __getitem__(self, index: int):
        self.left -= 1
        if self.left == 0:
            os.kill(os.getpid(), signal.SIGTERM)
        return self.samples[index]


class BrokenAt(KilledAt):
    """Samples of which the n-th reading finds a damaged file."""

    def __getitem__(self, index: int):
        self.left -= 1
        if self.left == 0:
            raise DatasetError("left/007.png: not a readable image")
        return self.samples[index]


def test_the_steps_before_a_broken_pair_are_saved(plane_samples, tmp_path) -> None:
    config = config_for(tmp_path, max_steps=30, cache=False, validate_every=0)
    with pytest.raises(DatasetError, match=r"^left/007\.png: not a readable image"):
        train(config, BrokenAt(plane_samples, 40), [])
    step = torch.load(tmp_path / "checkpoint.pt", weights_only=True)["step"]
    train(replace(config, max_steps=step + 1), plane_samples, [])
    kinds = [json.loads(line)["kind"] for line in (tmp_path / "log.jsonl").read_text().splitlines()]
    assert step > 1 and kinds.count("start") == 2


def test_a_killed_run_goes_on_to_the_same_weights(plane_samples, tmp_path) -> None:
    settings = {"max_steps": 8, "cache": False, "validate_every": 0}
    train(config_for(tmp_path / "whole", **settings), plane_samples, [])
    stopped = config_for(tmp_path / "stopped", **settings)
    with pytest.raises(KeyboardInterrupt):
        train(stopped, KilledAt(plane_samples, 13), [])
    state = torch.load(stopped.out / "checkpoint.pt", weights_only=True)
    assert 0 < state["step"] < 8
    train(stopped, plane_samples, [])
    whole, again = (torch.load(tmp_path / n / "checkpoint.pt", weights_only=True) for n in ("whole", "stopped"))
    assert again["step"] == whole["step"] == 8
    for part in ("model", "averaged"):
        for name, tensor in whole[part].items():
            assert torch.equal(tensor, again[part][name]), name


@pytest.mark.parametrize(("torchrun", "code"), [(False, 130), (True, 0)])
def test_the_command_saves_after_a_signal_and_exits_with_130_but_under_torchrun_with_0(
    plane_samples, tmp_path, monkeypatch, capsys, torchrun, code
) -> None:
    variables = {"LOCAL_RANK": "0", "RANK": "0", "WORLD_SIZE": "1", "MASTER_ADDR": "127.0.0.1", "MASTER_PORT": "0"}
    for name, value in variables.items() if torchrun else ():
        monkeypatch.setenv(name, value)
    killed = KilledAt(plane_samples, 13)
    monkeypatch.setattr("m3depth.datasets.open.open_pairs", lambda path, split, config: killed)
    flags = ["--data", "planes", "--out", str(tmp_path), "--batch", "2", "--crop", "32", "64", "--device", "cpu"]
    assert main([*flags, "--max-steps", "8", "--no-cache", "--validate-samples", "0"]) == code
    step = torch.load(tmp_path / "checkpoint.pt", weights_only=True)["step"]
    printed = capsys.readouterr().err
    assert 0 < step < 8 and f"stopped at step {step}, and saved it" in printed
    assert printed.endswith("error: interrupted; the same command goes on from here\n") != torchrun


def test_a_signal_during_the_last_save_costs_nothing(plane_samples, tmp_path, monkeypatch) -> None:
    save = Run.save

    def save_interrupted(run: Run) -> None:
        os.kill(os.getpid(), signal.SIGINT)
        save(run)

    monkeypatch.setattr(Run, "save", save_interrupted)
    train(config_for(tmp_path, max_steps=2, validate_every=0), plane_samples, [])
    assert torch.load(tmp_path / "checkpoint.pt", weights_only=True)["step"] == 2


SIX_STEPS = {"max_steps": 6, "cache": False, "validate_every": 2}


@pytest.fixture(scope="module")
def six_steps(plane_samples, tmp_path_factory) -> Path:
    """Folder of a run of SIX_STEPS that was not cut off."""
    out = tmp_path_factory.mktemp("six") / "whole"
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(model_module.PRESETS, "lite", SMALL)
        train(config_for(out, **SIX_STEPS), plane_samples, plane_samples)
    return out


@pytest.mark.parametrize("last", [2, 3, 6])
def test_a_run_cut_off_after_a_checkpoint_goes_on_to_the_same_state(
    plane_samples, six_steps, tmp_path, monkeypatch, last
) -> None:
    """As after kill -9 or a power cut: nothing is saved at the end, what came after the checkpoint is done again.

    A validation that was due after the checkpoint is made up for, the last one too. Weights, averaged weights,
    optimizer and log are those of a run that was not cut off, bit for bit.
    """
    cut = config_for(tmp_path / "cut", **SIX_STEPS, checkpoint_minutes=1e-9)  # after every step
    save, saves = Run.save, []

    def save_and_die(run: Run) -> None:
        save(run)
        saves.append(run.step)
        if run.step == last:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Run, "save", save_and_die)
        with pytest.raises(KeyboardInterrupt):
            train(cut, plane_samples, plane_samples)
    assert saves == list(range(1, last + 1))
    train(cut, plane_samples, plane_samples)
    whole, again = (torch.load(out / "checkpoint.pt", weights_only=True) for out in (six_steps, cut.out))
    for part in ("model", "averaged"):
        assert all(torch.equal(tensor, again[part][name]) for name, tensor in whole[part].items())
    assert whole["optimizer"]["param_groups"] == again["optimizer"]["param_groups"]
    for number, state in whole["optimizer"]["state"].items():
        assert all(torch.equal(state[name], again["optimizer"]["state"][number][name]) for name in state)
    logs = []
    for out in (six_steps, cut.out):
        lines = [json.loads(line) for line in (out / "log.jsonl").read_text().splitlines()]
        lines = [line for line in lines if line["kind"] not in ("start", "stop")]  # lines for each start and stop
        logs.append(
            [{k: v for k, v in r.items() if k not in ("minutes", "processor_minutes", "loader_share")} for r in lines]
        )
    assert logs[0] == logs[1]
    assert {record["kind"] for record in logs[0]} == {"train", "val", "val_raw"}


def test_a_validation_cut_off_before_its_panel_is_made_up_for(plane_samples, tmp_path, monkeypatch) -> None:
    config = config_for(tmp_path, max_steps=4, validate_every=2, checkpoint_minutes=1e-9)

    def die(examples, path):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("m3depth.training.validation.pairs_figure", die)
        with pytest.raises(KeyboardInterrupt):
            train(config, plane_samples, plane_samples)
    train(config, plane_samples, plane_samples)
    assert sorted(path.name for path in (tmp_path / "panels").iterdir()) == ["0000002.png", "0000004.png"]
    assert [record["step"] for record in records(tmp_path, "val")] == [2, 4]


def test_tensorboard_holds_curves_and_panels(plane_samples, tmp_path) -> None:
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    train(config_for(tmp_path, max_steps=2, validate_every=1), plane_samples, plane_samples)
    events = EventAccumulator(str(tmp_path / "tensorboard"), {"images": 0, "scalars": 0}).Reload()
    tags = events.Tags()
    assert {"train/loss", "train/lr", "val/epe", "val_raw/epe"} <= set(tags["scalars"])
    assert [event.step for event in events.Scalars("val/epe")] == [1, 2]  # the last one is that of the end, too
    logged = [json.loads(line) for line in (tmp_path / "log.jsonl").read_text().splitlines()]
    curve = [r["epe"] for r in logged if r["kind"] == "val"]
    assert [event.value for event in events.Scalars("val/epe")] == pytest.approx(curve, abs=1e-5)
    panel = events.Images("panel")[-1]
    drawn = cv2.imread(str(max((tmp_path / "panels").iterdir())))
    assert (panel.height, panel.width) == drawn.shape[:2]


def test_a_time_budget_counts_what_was_spent_before(plane_samples, tmp_path, capsys, monkeypatch) -> None:
    clock = iter(range(10**6))
    ticking = SimpleNamespace(
        monotonic=lambda: float(next(clock)), process_time=lambda: 0.0
    )  # a second goes by with every look at the clock
    monkeypatch.setattr("m3depth.training.loop.time", ticking)
    config = config_for(tmp_path, max_steps=None, max_minutes=2.0, validate_samples=0)
    train(config, plane_samples, [])
    state = torch.load(tmp_path / "checkpoint.pt", weights_only=True)
    assert 120 <= state["seconds"] < 140 and state["step"] > 5
    assert state["optimizer"]["param_groups"][0]["lr"] < 0.1 * config.lr  # the schedule is fitted to it
    train(replace(config, max_minutes=3.0), plane_samples, [])
    more = torch.load(tmp_path / "checkpoint.pt", weights_only=True)
    assert 180 <= more["seconds"] < 200 and more["step"] > state["step"]
    assert "ETA" in capsys.readouterr().err


def gradients(
    samples, config: TrainConfig, dtype: torch.dtype | None = None
) -> tuple[list[torch.Tensor], torch.Tensor]:
    run = Run(config, torch.device("cpu"))
    run.model.recompute = config.recompute
    batch = make_batch(PackedCache(samples, 0), 0, config.batch, config.crop, config.augment, config.seed)
    loss, _ = backward(run.model, batch, config, dtype)
    return [p.grad for p in run.model.parameters()], loss


def test_accumulated_gradients_are_the_mean_of_the_parts(plane_samples, tmp_path) -> None:
    config = config_for(tmp_path, batch=4)
    run = Run(config, torch.device("cpu"))
    batch = make_batch(PackedCache(plane_samples, 0), 0, 4, config.crop, config.augment, config.seed)
    assert [len(part.left) for part in batch.split(2)] == [2, 2]
    for part in batch.split(2):
        loss = total_loss(run.model(part.left, part.right, part.target.camera), part.target, config.loss)[0]
        (loss / 2).backward()
    listed, _ = gradients(plane_samples, replace(config, accumulate=2))
    for parameter, gradient in zip(run.model.parameters(), listed):
        torch.testing.assert_close(gradient, parameter.grad)


def test_rows_at_full_resolution_weigh_as_much_as_a_crop(plane_samples, large_samples, tmp_path) -> None:
    """Also where not every crop has such rows: their losses are added up and divided by the number of crops."""
    config = config_for(tmp_path, batch=4)
    run = Run(config, torch.device("cpu"))
    mixed = [plane_samples[0], large_samples[1], plane_samples[2], large_samples[3]]
    batch = make_batch(PackedCache(mixed, 0), 0, 4, config.crop, config.augment, config.seed)
    assert 0 < len(batch.finer) < 4
    loss, terms = backward(run.model, batch, config, None)
    output = run.model(batch.left, batch.right, batch.target.camera)
    finer = finer_losses(run.model, output, batch, config, None)
    crops = total_loss(output, batch.target, config.loss)[0]
    torch.testing.assert_close(loss, (crops + finer.sum() / 4).detach())
    torch.testing.assert_close(terms["finer"], finer.mean().detach())


def test_no_network_sees_more_than_a_part_of_a_batch(plane_samples, tmp_path, monkeypatch) -> None:
    """Neither in a step nor in the check before the weights are saved: the whole batch may not fit into memory."""
    sizes = []
    real = M3Depth.forward

    def counted(self, left, *more):
        sizes.append(len(left))
        return real(self, left, *more)

    monkeypatch.setattr(M3Depth, "forward", counted)
    train(config_for(tmp_path, max_steps=1, accumulate=2, validate_every=0), plane_samples, [])
    assert sizes == [1, 1, 1, 1]


def test_recomputed_activations_give_the_same_gradients(plane_samples, tmp_path) -> None:
    plain, loss = gradients(plane_samples, config_for(tmp_path))
    again, same = gradients(plane_samples, config_for(tmp_path, recompute=True))
    assert torch.equal(loss, same)
    for a, b in zip(plain, again):
        torch.testing.assert_close(a, b)


def test_bf16_is_near_fp32_and_trains(plane_samples, tmp_path) -> None:
    exact, loss = gradients(plane_samples, config_for(tmp_path))
    rounded, near = gradients(plane_samples, config_for(tmp_path), torch.bfloat16)
    assert near == pytest.approx(float(loss), rel=0.05) and near != loss
    both = [torch.cat([g.flatten() for g in gs]) for gs in (exact, rounded)]
    assert torch.nn.functional.cosine_similarity(*both, dim=0) > 0.8
    train(config_for(tmp_path, max_steps=2, precision="bf16", validate_every=0), plane_samples, [])
    state = torch.load(tmp_path / "checkpoint.pt", weights_only=True)
    assert all(tensor.dtype == torch.float32 and torch.isfinite(tensor).all() for tensor in state["model"].values())


def test_a_run_says_what_it_wrote_and_how_to_go_on(plane_samples, tmp_path, capsys) -> None:
    config = config_for(tmp_path, max_steps=3, validate_every=1)
    scores = train(config, plane_samples, plane_samples)
    output = capsys.readouterr()
    etas = [float(eta) for eta in re.findall(r"ETA ([\d.]+) min", output.err)]
    assert etas and etas[0] < 60  # two steps of a tiny network, not what a share of nothing would give
    weights = tmp_path / "weights.safetensors"
    assert output.out.startswith(f"{weights}: averaged weights of step 3")
    assert f"EPE {scores['epe']:.3f} px" in output.out
    assert f"m3depth.evaluate --data planes --split test --weights {weights}" in output.out

    before = (tmp_path / "checkpoint.pt").read_bytes()
    (tmp_path / "curves.png").unlink()  # as after a kill before it was drawn
    assert train(config, plane_samples, plane_samples) == {}
    assert "already at --max-steps 3 (step 3" in capsys.readouterr().out and (tmp_path / "curves.png").is_file()
    assert train(replace(config, max_steps=None, max_minutes=1e-4), plane_samples, plane_samples) == {}
    assert "already at --max-minutes 0.0001 (" in capsys.readouterr().out
    assert (tmp_path / "checkpoint.pt").read_bytes() == before
    train(replace(config, max_steps=4), plane_samples, plane_samples)
    assert "averaged weights of step 4" in capsys.readouterr().out


def test_the_best_validation_is_reported_if_it_was_not_the_last(tmp_path) -> None:
    run = Run(config_for(tmp_path), torch.device("cpu"))
    records = [{"step": n, "epe": epe, "abs_rel": 0.01, "normal": 9.0} for n, epe in ((1, 0.5), (2, None), (3, 0.7))]
    output = summary(run, records)
    assert "EPE 0.700 px" in output and "best EPE 0.500 px at step 1" in output
    assert "best EPE" not in summary(run, records[:1]) and "not validated" in summary(run, [])


def test_the_hint_scores_every_folder_as_it_was_read(tmp_path) -> None:
    reader = DataConfig(left="left/*.png", right="right/*.png", depth="depth/*.exr", calib=Path("natecam"), resize=0.5)
    config = replace(config_for(tmp_path), data=(Path("SimMars6K"), Path("more data")), reader=reader)
    hints = summary(Run(config, torch.device("cpu")), []).splitlines()[1:]
    assert [line.startswith("score them: python -m m3depth.evaluate ") for line in hints] == [True, True]
    parsed = [parse(EvaluateOptions, "evaluate", None, shlex.split(line)[5:]) for line in hints]
    assert [options.data for options in parsed] == list(config.data) and len({options.out for options in parsed}) == 2
    assert all(options.reader == reader and options.split == "test" for options in parsed)
    assert all(options.weights == (tmp_path / "weights.safetensors",) for options in parsed)


def test_without_validation_pairs_the_run_says_so_and_goes_on(plane_samples, tmp_path, capsys) -> None:
    assert train(config_for(tmp_path, max_steps=1), plane_samples, []) == {}
    output = capsys.readouterr()
    assert "planes: split val holds no pairs, so nothing is validated" in output.err and "not validated" in output.out


def no_number(output, target, config):
    loss, terms = total_loss(output, target, config)
    return loss * float("nan"), terms


FLAT = {"loss": 0.0, "disparity": 0.0, "normal": 0.0}  # what a step returns


def test_nan_stops_the_run_and_keeps_the_last_checkpoint(plane_samples, tmp_path, monkeypatch) -> None:
    config = config_for(tmp_path, max_steps=2, validate_every=0)
    train(config, plane_samples, [])
    before = (tmp_path / "checkpoint.pt").read_bytes()
    monkeypatch.setattr("m3depth.training.loop.total_loss", no_number)
    with pytest.raises(FloatingPointError, match=r"not finite at step 2; .*checkpoint\.pt holds the last good state"):
        train(replace(config, max_steps=4), plane_samples, [])
    assert (tmp_path / "checkpoint.pt").read_bytes() == before


def test_nan_before_the_first_checkpoint_says_that_nothing_is_saved(plane_samples, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("m3depth.training.loop.total_loss", no_number)
    with pytest.raises(FloatingPointError, match="at step 0; nothing is saved yet"):
        train(config_for(tmp_path), plane_samples, [])
    assert not (tmp_path / "checkpoint.pt").exists()


def test_a_resumed_run_says_which_settings_are_new(plane_samples, tmp_path, capsys) -> None:
    config = config_for(tmp_path, max_steps=1, validate_samples=0)
    train(config, plane_samples, [])
    assert "other settings" not in capsys.readouterr().err
    train(replace(config, max_steps=2), plane_samples, [])
    assert "goes on with other settings: --max-steps 2 (was 1)\n" in capsys.readouterr().err
    train(replace(config, max_steps=3, lr=1e-3, loss=LossConfig(rock=2.0)), plane_samples, [])
    output = capsys.readouterr().err
    assert "settings: --max-steps 3 (was 2), --lr 0.001 (was 0.005), --loss.rock 2.0 (was 4.0)\n" in output
    run = Run(replace(config, weight_decay=0.5, validate_samples=8), torch.device("cpu"))
    assert run.resume() and "--weight-decay 0.5 (was 0.0001)" in run.changed
    assert "--validate-samples 8 (was 0)" in run.changed
    assert [group["weight_decay"] for group in run.optimizer.param_groups] == [0.5]
    reader = DataConfig(resize=0.5)
    changed = replace(config, max_steps=4, lr=1e-3, loss=LossConfig(rock=2.0), accumulate=2, reader=reader)
    train(changed, plane_samples, [])
    output = capsys.readouterr().err
    assert "settings: --max-steps 4 (was 3), --accumulate 2 (was 1), --resize 0.5 (was 1.0)\n" in output
    train(replace(changed, max_steps=5), plane_samples[:-1], [])
    output = capsys.readouterr().err
    assert "settings: --max-steps 5 (was 4), the pairs in --data are others, or their files were " in output


def test_a_resumed_run_says_that_its_device_is_another(tmp_path) -> None:
    config = config_for(tmp_path, precision="auto")
    run = Run(config, torch.device("cpu"))
    run.save()
    again = Run(config, torch.device("cpu"))
    again.device = torch.device("meta")
    assert again.resume() and "--device meta (was cpu)" in again.changed


def test_a_resumed_run_says_that_epochs_give_its_steps_now(plane_samples, tmp_path, capsys) -> None:
    config = config_for(tmp_path, max_steps=1, validate_samples=0)
    train(config, plane_samples, [])
    epochs = replace(config, max_steps=None, epochs=2)
    capsys.readouterr()
    train(epochs, plane_samples, [])
    assert "settings: --max-steps none (was 1), --epochs 2 (was none)\n" in capsys.readouterr().err
    train(replace(epochs, epochs=3), plane_samples, [])
    assert "settings: --epochs 3 (was 2)\n" in capsys.readouterr().err


def test_a_budget_that_is_over_before_the_first_step_leaves_weights(plane_samples, tmp_path, capsys) -> None:
    config = config_for(tmp_path, max_steps=None, max_minutes=1e-9)
    train(config, plane_samples, plane_samples[:1])
    assert f"{tmp_path / 'weights.safetensors'}: averaged weights of step 0" in capsys.readouterr().out
    assert M3Depth.from_pretrained(tmp_path / "weights.safetensors").config == SMALL
    train(replace(config, max_steps=2, max_minutes=None), plane_samples, [])
    assert "resumed at step 0" in capsys.readouterr().err


def test_a_run_goes_on_from_its_own_beginning_alone(plane_samples, tmp_path, monkeypatch) -> None:
    """Weights given to a resumed run would be loaded, and overwritten by the checkpoint."""
    for name in ("one", "two"):
        M3Depth(SMALL).save_pretrained(tmp_path / f"{name}.safetensors")
    config = config_for(tmp_path / "run", max_steps=1, validate_samples=0, init=tmp_path / "one.safetensors")
    train(config, plane_samples, [])
    with pytest.raises(ValueError, match=r"belongs to a run with init .*one\.safetensors, not .*two\.safetensors"):
        train(replace(config, max_steps=2, init=tmp_path / "two.safetensors"), plane_samples, [])
    monkeypatch.chdir(tmp_path)
    spelt_otherwise = replace(config, max_steps=2, init=Path("run/../one.safetensors"))
    (tmp_path / "one.safetensors").unlink()  # the checkpoint holds what is left of them
    train(spelt_otherwise, plane_samples, [])
    assert Run(spelt_otherwise, torch.device("cpu")).model.config == SMALL


@pytest.mark.parametrize(
    ("message", "is_lost"),
    [
        ("[gloo/pair.cc:553] Connection closed by peer", True),
        ("NCCL: duplicate GPU", False),
        ("[gloo/unbound_buffer.cc:81] Timed out waiting 15000ms for send operation to complete", True),
    ],
)
def test_a_lost_process_of_torchrun_is_one_line(plane_set, tmp_path, monkeypatch, capsys, message, is_lost) -> None:
    def lost(*given: object) -> None:
        raise RuntimeError(message)

    monkeypatch.setenv("LOCAL_RANK", "0")
    monkeypatch.setattr("m3depth.training.loop.train", lost)
    monkeypatch.setattr("os._exit", lambda code: None)
    flags = ["--data", str(plane_set), "--out", str(tmp_path / "run"), "--max-steps", "1"]
    if is_lost:
        assert main(flags) == 2
        assert capsys.readouterr().err == (
            f"error: another process of this training has ended, see its own error: {message}\n"
        )
    else:
        assert main(flags) == 1
        printed = capsys.readouterr().err
        assert printed.startswith("Traceback") and printed.endswith("RuntimeError: NCCL: duplicate GPU\n")


@pytest.mark.parametrize(
    ("flags", "advice"),
    [
        ("--batch 12", "take the 12 crops of a step in more parts, with --accumulate 2"),
        ("--batch 12 --accumulate 4", "take the 12 crops of a step in more parts, with --accumulate 6"),
        ("--batch 2 --accumulate 2", "add --recompute, or take smaller crops with --crop"),
        ("--batch 2 --accumulate 2 --recompute", "take smaller crops with --crop"),
    ],
)
def test_a_step_that_does_not_fit_is_one_line_with_the_flag_that_helps(
    plane_set, tmp_path, monkeypatch, capsys, flags, advice
) -> None:
    def too_large(*given: object) -> None:
        raise torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 20 GiB.\nSee the documentation")

    monkeypatch.setattr("m3depth.training.loop.one_step", too_large)
    run = ["--out", str(tmp_path / "run"), "--max-steps", "1", "--crop", "32", "64", "--device", "cpu"]
    assert main(["--data", str(plane_set), *run, *flags.split()]) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert error == f"error: out of memory ({advice}; CUDA out of memory. Tried to allocate 20 GiB.)"


def test_a_run_goes_on_where_its_folders_have_moved(plane_samples, tmp_path, monkeypatch) -> None:
    here, there = tmp_path / "here", tmp_path / "there"
    M3Depth(SMALL).save_pretrained(here / "one.safetensors")
    for folder, steps in ((here, 1), (there, 2)):
        monkeypatch.chdir(folder)
        config = config_for(Path("run"), max_steps=steps, validate_samples=0, init=Path("one.safetensors"))
        train(config, plane_samples, [])
        if folder == here:
            shutil.move(here, there)
    assert records(Path("run"), "train")[-1]["step"] == 1 and saved_progress(Path("run"))[0] == 2
    torch.manual_seed(9)
    M3Depth(SMALL).save_pretrained("one.safetensors")
    with pytest.raises(ValueError, match="belongs to a run with init"):
        monkeypatch.chdir(shutil.move(there, here))
        train(replace(config, max_steps=3), plane_samples, [])


@pytest.mark.parametrize("ended", ["killed", "signal"])
def test_a_validation_is_of_a_step_that_is_saved(plane_samples, tmp_path, monkeypatch, ended) -> None:
    """What stops a run may kill it before the validation is over."""
    config = config_for(tmp_path / "run", max_steps=4, validate_every=2, checkpoint_minutes=1e6)

    def killed(validator: Validator) -> None:
        raise SystemExit

    def step_and_stop(run: Run, *given: object) -> dict[str, float]:
        values = one_step(run, *given)
        if run.step == 2:
            os.kill(os.getpid(), signal.SIGTERM)
        return values

    with monkeypatch.context() as patch:
        patch.setattr(Validator, "validate", killed)
        if ended == "signal":
            patch.setattr("m3depth.training.loop.one_step", step_and_stop)
        with pytest.raises(SystemExit if ended == "killed" else KeyboardInterrupt):
            train(config, plane_samples, plane_samples)
    assert saved_progress(config.out)[0] == 2
    train(config, plane_samples, plane_samples)
    assert [record["step"] for record in records(config.out, "val")] == [2, 4]


def test_no_checkpoint_is_ahead_of_its_weights(plane_samples, tmp_path, monkeypatch) -> None:
    """A disk that is full between the two: the run goes on from before, and writes both."""
    config = config_for(tmp_path, max_steps=2, validate_samples=0)
    real = run_module.write_atomically

    def full(path, content):
        raise OSError(28, "No space left on device", str(path))

    monkeypatch.setattr(run_module, "write_atomically", full)
    with pytest.raises(OSError, match="No space"):
        train(config, plane_samples, [])
    assert not (tmp_path / "checkpoint.pt").exists()
    monkeypatch.setattr(run_module, "write_atomically", real)
    train(config, plane_samples, [])
    state = torch.load(tmp_path / "checkpoint.pt", weights_only=True)["averaged"]
    saved = M3Depth.from_pretrained(tmp_path / "weights.safetensors").state_dict()
    assert all(torch.equal(saved[name], tensor) for name, tensor in state.items())


def test_a_learning_rate_beyond_all_reason_ends_in_one_line(plane_samples, tmp_path, monkeypatch) -> None:
    """The weights of the second step make NaN inside the network, not first in the loss."""
    monkeypatch.setattr("m3depth.training.loop.check_config", lambda config: None)  # which refuses such a rate
    with pytest.raises(FloatingPointError, match="is not finite at step 1; nothing is saved yet"):
        train(config_for(tmp_path, lr=1e30, clip=1e30, validate_samples=0), plane_samples, [])


@pytest.mark.parametrize(("lr", "fault"), [(math.inf, "are not finite"), (1e30, r"reach \d\.?\d*e\+\d\d")])
def test_a_last_step_that_diverges_is_not_saved(plane_samples, tmp_path, capsys, monkeypatch, lr, fault) -> None:
    """No loss has seen the weights after it."""
    config = config_for(tmp_path, max_steps=1, validate_every=0)
    train(config, plane_samples, plane_samples)
    before = {file.name: file.read_bytes() for file in tmp_path.glob("*.*t*") if file.name != "log.jsonl"}
    monkeypatch.setattr("m3depth.datasets.open.open_pairs", lambda path, split, config: plane_samples)
    monkeypatch.setattr("m3depth.training.loop.check_config", lambda config: None)  # which refuses such a rate
    monkeypatch.setattr("marssim.base.command.flags.check_number", lambda *number, **more: None)
    flags = ["--data", "planes", "--out", str(tmp_path), "--batch", "2", "--crop", "32", "64", "--device", "cpu"]
    capsys.readouterr()
    assert main([*flags, "--max-steps", "2", "--lr", str(lr)]) == 1
    printed = capsys.readouterr()
    message = rf"error: training has diverged: weights {fault} at step 2; .*checkpoint\.pt holds the last good state"
    assert re.match(message, printed.err.splitlines()[-1]) and "done" not in printed.err and not printed.out
    assert {file.name: file.read_bytes() for file in tmp_path.glob("*.*t*") if file.name != "log.jsonl"} == before
    assert {"checkpoint.pt", "weights.safetensors"} <= before.keys()


def test_weights_that_are_finite_and_useless_are_not_saved_either(plane_samples, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("m3depth.training.ending.LARGEST_LOSS", 1.0)  # [px]
    monkeypatch.setattr("m3depth.training.loop.one_step", lambda run, *more: setattr(run, "step", run.step + 1) or FLAT)
    with pytest.raises(FloatingPointError, match=r"loss is \d\S* at step 1; nothing is saved yet"):
        train(config_for(tmp_path, max_steps=1, validate_every=0), plane_samples, [])
    assert not (tmp_path / "checkpoint.pt").exists()


def test_checkpoint_is_of_one_number_of_processes(tmp_path) -> None:
    config, cpu = config_for(tmp_path), torch.device("cpu")
    run = Run(config, cpu, world=1)
    run.step = 7
    run.save()
    with pytest.raises(ValueError, match="number of processes 1, not 2"):
        Run(config, cpu, world=2).resume()
    state = torch.load(run.checkpoint, weights_only=True)
    del state["identity"]["number of processes"]  # as single processes used to write it
    del state["identity"]["network"]["slice_dilated"]  # before the field was there
    torch.save(state, run.checkpoint)
    again = Run(config, cpu, world=1)
    assert again.resume() and again.step == 7
    with pytest.raises(ValueError, match="number of processes 1, not 2"):
        Run(config, cpu, world=2).resume()


def test_crops_that_the_network_pads_train_too(plane_samples, tmp_path) -> None:
    """Wavelets of two levels at 1/8 need multiples of 32; the coarse maps that the loss sees end with the crop."""
    config = config_for(tmp_path, max_steps=1, crop=(40, 72), validate_every=0)
    train(config, plane_samples, [])
    out = Run(config, torch.device("cpu")).model(torch.rand(1, 3, 40, 72), torch.rand(1, 3, 40, 72), torch.ones(1, 4))
    assert [x.shape[-2:] for x in (*out.initial, *out.steps[-1])] == [(5, 9), (5, 9), (10, 18), (10, 18)]


def test_a_custom_network_comes_from_a_file(plane_samples, tmp_path) -> None:
    file = tmp_path / "net.json"
    file.write_text(json.dumps({**asdict(SMALL), "refine_steps": 0, "lookup_levels": 0, "wavelet_levels": [0, 1]}))
    train(config_for(tmp_path / "run", network=file, max_steps=1, validate_every=0), plane_samples, [])
    made = M3Depth.from_pretrained(tmp_path / "run" / "weights.safetensors").config
    assert made == replace(SMALL, refine_steps=0, lookup_levels=0, wavelet_levels=(0, 1))
    for text, message in (
        ("[1]", "holds no JSON object"), ("{", "not readable as JSON"), ('{"hiden": 8}', "network config: unknown"),
        ('{"wavelet_kernel": 4}', "wavelet_kernel must be odd"),
    ):  # fmt: skip
        file.write_text(text)
        with pytest.raises(ValueError, match=rf"net\.json: {message}"):
            train(config_for(tmp_path / "other", network=file), plane_samples, [])
    with pytest.raises(FileNotFoundError, match=r"none\.json: no such file"):
        train(config_for(tmp_path / "other", network=tmp_path / "none.json"), plane_samples, [])


def test_weights_to_start_from_that_cannot_be_read_are_named_with_their_flag(plane_samples, tmp_path) -> None:
    bad = tmp_path / "bad.safetensors"
    bad.write_bytes(b"no weights at all")
    reason = r"not a readable \.safetensors file \(.*\); give a weights\.safetensors that m3depth\.train wrote"
    with pytest.raises(ValueError, match=rf"^--init {bad}: {reason}$"):
        train(config_for(tmp_path / "run", init=bad), plane_samples, [])


def test_warm_start_takes_weights_and_their_config(plane_samples, tmp_path) -> None:
    torch.manual_seed(5)
    M3Depth(replace(SMALL, hidden=16)).save_pretrained(tmp_path / "init.safetensors")
    config = config_for(tmp_path / "run", init=tmp_path / "init.safetensors", max_steps=1, lr=1e-9, validate_every=0)
    train(config, plane_samples, [])
    first, last = (M3Depth.from_pretrained(p) for p in (config.init, config.out / "weights.safetensors"))
    assert last.config.hidden == 16
    for a, b in zip(first.parameters(), last.parameters()):
        torch.testing.assert_close(a, b, atol=1e-6, rtol=0)


@pytest.mark.parametrize("flag", ["preset", "network"])
def test_a_flag_that_names_another_network_than_that_of_the_first_weights_is_refused(
    plane_samples, tmp_path, monkeypatch, flag
) -> None:
    init = tmp_path / "init.safetensors"
    new_network(TINY["light-stereo"]).save_pretrained(init)
    other = {"preset": "paper", "network": tmp_path / "other.json"}[flag]
    (tmp_path / "other.json").write_text(json.dumps(replace(TINY["light-stereo"], half=4).to_dict()))
    what = {"preset": "kind light-stereo, not m3depth", "network": "half 8, not 4"}[flag]
    config = config_for(tmp_path / "run", init=init, max_steps=1, batch=1, validate_samples=0)
    refused = rf"^--{flag} {other}: the weights of --init are of another network: {what}; leave one of the two out$"
    with pytest.raises(ValueError, match=refused):
        train(replace(config, **{flag: other}), plane_samples, [])
    (tmp_path / "other.json").write_text(json.dumps(TINY["light-stereo"].to_dict()))
    monkeypatch.setitem(PRESETS, "light-stereo", TINY["light-stereo"])
    train(replace(config, **{flag: {"preset": "light-stereo", "network": other}[flag]}), plane_samples, [])
    (tmp_path / "other.json").write_text(json.dumps(replace(TINY["light-stereo"], half=4).to_dict()))
    with pytest.raises(ValueError, match=refused):  # when it goes on, too
        train(replace(config, max_steps=2, **{flag: other}), plane_samples, [])


def test_fine_tuning_starts_from_the_shipped_weights_by_their_name(plane_samples, tmp_path, capsys) -> None:
    """A checkpoint has their name, not a path: it is resumed where the package lies elsewhere, too."""
    config = config_for(tmp_path / "run", init=Path("shipped"), max_steps=1, batch=1, lr=1e-9, validate_samples=0)
    train(config, plane_samples, [])
    shipped, tuned = M3Depth.from_pretrained(), M3Depth.from_pretrained(config.out / "weights.safetensors")
    assert shipped.config == tuned.config != SMALL
    for a, b in zip(shipped.parameters(), tuned.parameters()):
        torch.testing.assert_close(a, b, atol=1e-6, rtol=0)
    checkpoint = config.out / "checkpoint.pt"
    state = torch.load(checkpoint, weights_only=True)
    assert state["identity"]["init"] == "shipped"
    with pytest.raises(ValueError, match=r"belongs to a run with init shipped, not .*other\.safetensors"):
        train(replace(config, max_steps=2, init=tmp_path / "other.safetensors"), plane_samples, [])
    # Checkpoints of the first release have the path that was typed.
    torch.save(state | {"identity": state["identity"] | {"init": str(SHIPPED_WEIGHTS)}}, checkpoint)
    train(replace(config, max_steps=2), plane_samples, [])
    assert "resumed at step 1" in capsys.readouterr().err
    train(replace(config, max_steps=3, init=SHIPPED_WEIGHTS), plane_samples, [])
    assert "resumed at step 2" in capsys.readouterr().err


def test_a_run_draws_its_curves_and_names_the_picture(plane_samples, tmp_path, capsys) -> None:
    config = config_for(tmp_path / "validated", max_steps=2)
    train(config, plane_samples, plane_samples)
    assert f"{config.out / 'curves.png'}: curves of the loss and the validations\n" in capsys.readouterr().out
    assert cv2.imread(str(config.out / "curves.png")) is not None
    config = config_for(tmp_path / "not validated", max_steps=1)
    train(config, plane_samples, [])
    assert str(config.out / "curves.png") in capsys.readouterr().out
    assert cv2.imread(str(config.out / "curves.png")) is not None


def test_curves_are_drawn_at_validations_and_at_the_end(plane_samples, tmp_path, monkeypatch) -> None:
    """Not at a validation that follows the last drawing at once: a drawing takes half a second."""
    drawn: list[str] = []
    monkeypatch.setattr("m3depth.training.validation.save_curves", lambda out: drawn.append("validation"))
    monkeypatch.setattr("m3depth.training.loop.save_curves", lambda out: drawn.append("end"))
    config = config_for(tmp_path / "soon", max_steps=3, validate_every=1)
    monkeypatch.setattr("m3depth.training.validation.CURVES_SECONDS", 1e6)  # however busy the machine is
    train(config, plane_samples, plane_samples)
    assert drawn == ["end"]
    drawn.clear()
    monkeypatch.setattr("m3depth.training.validation.CURVES_SECONDS", -1.0)
    train(replace(config, out=tmp_path / "later"), plane_samples, plane_samples)
    assert drawn == ["validation"] * 3 + ["end"]


def test_settings_that_cannot_work_are_named(plane_samples, tmp_path) -> None:
    for changes, message in (
        ({"max_steps": None}, "--max-minutes"),
        ({"crop": (36, 64)}, "--crop 36 64"),
        ({"lr": 0.0}, "--lr"),
        ({"lr": 1e300}, "--lr must be above 0 and at most 10, got 1e"),
        ({"lr": math.inf}, "--lr must be above 0 and at most 10, got inf"),
        ({"clip": math.nan}, "--clip"),
        ({"batch": 10**8}, "--batch must be above 0 and at most 4096, got 1e"),
        ({"crop": (1 << 20, 64)}, "--crop 1048576 64: both must be multiples of 8, up to 16384"),
        ({"seed": -1}, "--seed"),
        ({"ema": 1.0}, "--ema"),
        ({"validate_every": -1}, "--validate-every"),
        ({"device": "tpu"}, "--device tpu"),
        ({"accumulate": 3}, "--accumulate 3: --batch 2"),
        ({"accumulate": 0}, "--accumulate"),
    ):
        with pytest.raises(ValueError, match=message):
            train(config_for(tmp_path, **changes), plane_samples, [])
    train(config_for(tmp_path, max_steps=1, validate_every=0), plane_samples, [])
    with pytest.raises(ValueError, match="belongs to a run with batch 2, not 1"):
        train(config_for(tmp_path, batch=1), plane_samples, [])
    (tmp_path / "checkpoint.pt").write_bytes(b"half a file")
    with pytest.raises(ValueError, match=r"checkpoint\.pt: not a readable .* --init .*weights\.safetensors"):
        train(config_for(tmp_path), plane_samples, [])


def test_command_names_what_is_missing_and_exits_2(tmp_path, capsys) -> None:
    assert main(["--data", str(tmp_path / "none"), "--out", str(tmp_path / "run"), "--max-steps", "1"]) == 2
    assert capsys.readouterr().err == f"error: {tmp_path / 'none'}: no such folder\n"


def test_out_that_is_a_file_is_one_line_and_exit_2(plane_samples, tmp_path, capsys, monkeypatch) -> None:
    monkeypatch.setattr("m3depth.datasets.open.open_pairs", lambda path, split, config: plane_samples)
    (tmp_path / "run").write_text("")
    assert main(["--data", "planes", "--out", str(tmp_path / "run"), "--max-steps", "1", "--crop", "32", "64"]) == 2
    last = capsys.readouterr().err.splitlines()[-1]
    assert last.startswith("error: ") and str(tmp_path / "run") in last


@pytest.mark.skipif(lock.fcntl is None, reason="this system has no flock")
def test_a_second_run_in_the_folder_is_refused_and_the_first_is_whole(plane_samples, tmp_path, capsys) -> None:
    config = config_for(tmp_path / "run", max_steps=2, validate_every=0)

    class SecondRun:
        """Samples of the first run, whose first reading starts a second run in the same folder."""

        refusals: ClassVar[list[str]] = []

        def __len__(self) -> int:
            return len(plane_samples)

        def __getitem__(self, index: int):
            if not self.refusals:
                self.refusals.append("")
                with pytest.raises(FolderInUse) as refusal:
                    train(replace(config, max_steps=4), plane_samples, [])
                self.refusals[:] = [str(refusal.value)]
            return plane_samples[index]

    train(config, SecondRun(), [])
    assert f"{config.out}: another command (process {os.getpid()} " in SecondRun.refusals[0]
    state = torch.load(config.out / "checkpoint.pt", weights_only=True)
    assert state["step"] == 2 and state["settings"]["--max-steps"] == "2"
    train(replace(config, max_steps=3), plane_samples, [])
    assert not (config.out / ".lock").exists()


def test_half_written_files_of_a_killed_run_are_deleted(plane_samples, tmp_path) -> None:
    (tmp_path / "panels").mkdir()
    halves = [tmp_path / ".checkpoint.pt.77.part", tmp_path / "panels" / ".0000500.png.77.part"]
    for half in halves:
        half.write_bytes(b"half")
    train(config_for(tmp_path, max_steps=1, validate_samples=0), plane_samples, [])
    assert not any(half.exists() for half in halves)


def test_a_crop_that_no_image_holds_leaves_nothing(plane_samples, tmp_path) -> None:
    with pytest.raises(ValueError, match="--crop 512 512 is larger than the images, 64 x 96 px in "):
        train(config_for(tmp_path / "run", crop=(512, 512)), plane_samples, [])
    assert not (tmp_path / "run").exists()


def test_each_dataset_must_hold_the_crop(plane_samples, large_samples, tmp_path) -> None:
    both = JoinedPairs([large_samples, plane_samples])
    with pytest.raises(ValueError, match="--crop 96 96 is larger than the images, 64 x 96 px in "):
        train(config_for(tmp_path / "run", crop=(96, 96)), both, [])
    assert not (tmp_path / "run").exists()


def test_a_dataset_takes_no_run(plane_samples, tmp_path) -> None:
    (tmp_path / "scenes").mkdir()
    (tmp_path / "generate.json").write_text("{}")
    with pytest.raises(ValueError, match="run: lies in the dataset"):
        train(config_for(tmp_path / "run"), plane_samples, [])


def test_a_folder_without_test_pairs_is_reported_instead_of_a_command_that_fails(tmp_path, monkeypatch) -> None:
    pairs = {"one scene": 0, "ten": 2}
    monkeypatch.setattr("m3depth.training.messages.open_pairs", lambda path, split, config: [None] * pairs[path.name])
    config = replace(config_for(tmp_path), data=(Path("one scene"), Path("ten")))
    hints = summary(Run(config, torch.device("cpu")), []).splitlines()[1:]
    assert hints[0] == "one scene: split test holds no pairs to score them on; more scenes would have some"
    assert len(hints) == 2 and "m3depth.evaluate --data ten --split test" in hints[1]


@pytest.mark.parametrize(
    ("flag", "value"),
    [
        ("--augment.contrast", "-2"), ("--loss.rock", "-2"), ("--augment.blur", "101"), ("--augment.noise", "1.1"),
        ("--augment.vertical", "17"), ("--augment.vertical", "nan"),
    ],
)  # fmt: skip
def test_a_bad_nested_value_names_its_flag_and_exits_2(capsys, flag, value) -> None:
    assert main(["--data", "planes", "--out", "run", flag, value]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"error: {flag} must ") and error.count("\n") == 1


def test_schedule_rises_then_falls() -> None:
    rates = [learning_rate(1.0, i / 100) for i in range(101)]
    assert rates[0] == pytest.approx(0.05)
    assert max(rates) == rates[4] == pytest.approx(1.0)
    assert rates[100] == pytest.approx(0.01)
    assert rates[4:] == sorted(rates[4:], reverse=True)
