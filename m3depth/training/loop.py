"""The training loop behind `python -m m3depth.train`."""

from __future__ import annotations

import math
import os
import shlex
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing, nullcontext
from pathlib import Path
from typing import Any

import cv2
import torch
from torch import Tensor, nn

from m3depth.datasets.open import open_pairs
from m3depth.network.device import autocast, fast_dtype
from m3depth.stereo.pairs import StereoPairs, spread
from m3depth.training.augmentation import check_crop
from m3depth.training.batch import Batch
from m3depth.training.budget import share_done, spent_budget
from m3depth.training.config import TrainConfig, check_config
from m3depth.training.curves import CURVES, save_curves
from m3depth.training.log import Log, records
from m3depth.training.losses import total_loss
from m3depth.training.process_group import agree, entered_by_first, joined_group
from m3depth.training.run import Run
from m3depth.training.samples import PackedCache, batches, free_memory
from m3depth.training.validation import save_panel, validate
from marssim.base.command.notes import counted
from marssim.base.command.signals import stop_on_signal
from marssim.base.results.claim import ResultFolder

WARM_UP = 0.04  # share of the run in which the learning rate rises
CURVES_SECONDS = 10.0  # least time between two drawings of the curves in a run [s]; one takes a quarter of a second


def learning_rate(peak: float, progress: float) -> float:
    """One cycle: linear rise, then a cosine down to a hundredth. progress: share of the run that is done."""
    if progress < WARM_UP:
        return peak * (0.05 + 0.95 * progress / WARM_UP)
    fall = min(1.0, (progress - WARM_UP) / (1 - WARM_UP))
    return peak * (0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * fall)))


class Checks:
    """Quick validation of a run's raw and averaged weights, on rank 0, where there is something to validate on."""

    def __init__(self, run: Run, log: Log | None, held_out: StereoPairs) -> None:
        self.run, self.log = run, log
        self.chosen = spread(len(held_out), run.config.validate_samples) if log else []
        self.cache = PackedCache(held_out, free_memory() // 4 if run.config.cache else 0)
        self.step, self.scores = -1, dict[str, float]()
        self.drawn = time.monotonic()  # when the curves were drawn last; the end of a run draws them too

    def __call__(self) -> dict[str, float]:
        """Scores of the averaged weights as they are now, logged with a panel; empty where nothing is validated."""
        run, log = self.run, self.log
        if not self.chosen or log is None or self.step == run.step:
            return self.scores
        packed = [self.cache[i] for i in self.chosen]
        raw = validate(run.model, packed, run.device)
        self.step, self.scores = run.step, validate(run.averaged, packed, run.device)
        log.write("val_raw", run.step, raw)
        log.write("val", run.step, self.scores)
        path = run.config.out / "panels" / f"{run.step:07d}.png"
        log.image("panel", run.step, save_panel(path, run.averaged, packed[:4], run.device))
        if time.monotonic() - self.drawn > CURVES_SECONDS:
            save_curves(run.config.out)
            self.drawn = time.monotonic()
        shown = "  ".join(f"{k} {v:.4g}" for k, v in self.scores.items())
        log.say(f"validation, step {run.step}: {shown}")
        return self.scores


def train(config: TrainConfig, samples: StereoPairs, held_out: StereoPairs) -> dict[str, float]:
    """Train until the budget is spent or a signal comes; both leave a checkpoint that the same call continues.

    SIGTERM and SIGINT stop a training that is called from the main thread.

    Args:
        config: The run, its folder and its budget.
        samples: Stereo samples to train on (fields as in marssim.base.dataset.dataset).
        held_out: Samples to validate on; without any, nothing is validated.

    Returns:
        The last validation of the averaged weights; empty after a signal, without `held_out`, and where the run was
        done before.

    Raises:
        ValueError: Bad settings.
        FolderInUse: Another command writes to the folder of the run.
        FloatingPointError: The loss is not finite; the last checkpoint stays as it was.
    """
    check_config(config)
    folder = ResultFolder(config.out, "training run")
    folder.check()
    if not len(samples):
        raise ValueError(f"{named(config)}: split train holds no pairs")
    cv2.setNumThreads(1)
    with joined_group(config.device) as (rank, world, device), entered_by_first(rank, world, folder.claim()):
        run = Run(config, device, world)
        resumed = run.resume()
        check_common_step(run)
        if budget := spent_budget(config, run.step, run.seconds):
            return done_before(run, budget, held_out) if rank == 0 else {}
        local = int(os.environ.get("LOCAL_WORLD_SIZE", 1))
        cache = PackedCache(samples, free_memory() // 2 // local if config.cache else 0)
        check_crop(cache[0], config.crop)  # before anything is written
        with ExitStack() as opened:
            log = opened.enter_context(closing(Log(config.out, run.step))) if rank == 0 else None
            if log:
                announce(run, resumed, len(samples), len(held_out))
            stream = opened.enter_context(
                closing(
                    batches(
                        cache, run.step, config.batch, config.crop, config.augment, config.seed, rank, world,
                        config.loader_threads,
                    )
                )
            )  # fmt: skip
            check = Checks(run, log, held_out)
            if log and resumed and validation_is_due(run) and not is_validated(run):
                check()
            stopped = take_steps(run, stream, log, check)
            return closed(run, log, check, stopped) if log else {}


def done_before(run: Run, budget: str, held_out: StereoPairs) -> dict[str, float]:
    """Say that a run's budget is spent; or validate it, if it was killed between its last step and its end."""
    if len(held_out) and run.config.validate_samples and not is_validated(run):
        with closing(Log(run.config.out, run.step)) as log:
            return closed(run, log, Checks(run, log, held_out), stopped=False)
    minutes = run.seconds / 60
    print(f"{run.config.out}: already at {budget} (step {run.step}, {minutes:.1f} min); raise it to go on")
    return {}


def validation_is_due(run: Run) -> bool:
    """Is it the turn of a quick validation, after the step that the run stands at?"""
    every = run.config.validate_every
    return every > 0 and run.step > 0 and run.step % every == 0


def is_validated(run: Run) -> bool:
    """Does the log tell a validation of the step that the run stands at?"""
    return any(record["step"] == run.step for record in records(run.config.out, "val"))


def closed(run: Run, log: Log, check: Checks, stopped: bool) -> dict[str, float]:
    """Save a run that a signal stopped, or that is done, and say so. Returns the scores of one that is done."""
    run.save()
    scores = {} if stopped else check()
    save_curves(run.config.out)
    if stopped:
        log.say(f"stopped at step {run.step}; the same command goes on from here")
        return {}
    log.say("done")
    print(closing_words(run, records(run.config.out, "val")), flush=True)
    return scores


def announce(run: Run, resumed: bool, samples: int, held_out: int) -> None:
    """Say on stderr what is trained, on how many samples and on what, and what a resumed run has new."""
    size = sum(p.numel() for p in run.model.parameters())
    start = f"resumed at step {run.step}, {run.seconds / 60:.1f} min" if resumed else "new run"
    print(
        f"{counted(samples, 'sample')}, {size / 1e6:.2f} M parameters, {run.device}, {start}",
        file=sys.stderr,
        flush=True,
    )
    if run.changed:
        print(f"goes on with other settings: {', '.join(run.changed)}", file=sys.stderr, flush=True)
    if run.config.validate_samples and not held_out:
        print(f"{named(run.config)}: split val holds no pairs, so nothing is validated", file=sys.stderr, flush=True)


def take_steps(run: Run, stream: Iterator[Batch], log: Log | None, check: Checks) -> bool:
    """Step until the budget is spent or a signal comes; returns whether it was a signal.

    log: of rank 0, which saves checkpoints and validates; None in the other processes.
    """
    config, device, world = run.config, run.device, run.world
    network: nn.Module = run.model
    if world > 1:
        network = nn.parallel.DistributedDataParallel(run.model, [device.index] if device.type == "cuda" else None)
    dtype = {"auto": fast_dtype(device), "fp32": None, "bf16": torch.bfloat16}[config.precision]
    run.model.recompute = config.recompute
    spent_before, began, saved = run.seconds, time.monotonic(), time.monotonic()
    waited = 0.0
    with stop_on_signal() as signals:
        while True:
            # All processes must take the same decisions: the clock is rank 0's, a signal or NaN anybody's.
            run.seconds = spent_before + time.monotonic() - began
            clock, stopped = agree([run.seconds if log else 0.0, float(bool(signals))], device, world)
            done = share_done(config, run.step, clock)
            if stopped or done >= 1:
                return bool(stopped)
            before = time.monotonic()
            batch = next(stream).to(device)
            waited += time.monotonic() - before
            values = one_step(run, network, batch, learning_rate(config.lr, done), dtype)
            run.seconds = spent_before + time.monotonic() - began
            if log is None:
                continue
            if run.step % 10 == 0 or run.step == 1:
                share = waited / max(time.monotonic() - began, 1e-9)
                log.write("train", run.step, values | {"minutes": run.seconds / 60, "loader_share": share})
            done = min(1.0, share_done(config, run.step, run.seconds))  # of this step too: the first one has an ETA
            left = run.seconds * (1 - done) / done
            log.progress(
                f"step {run.step}  {done:6.1%}  ETA {left / 60:.1f} min  loss {values['loss']:.3f}  "
                f"d {values['disparity']:.3f}  n {values['normal']:.3f}  "
                f"{config.batch * world * run.step / max(run.seconds, 1e-9):.2f} crops/s"
            )
            if time.monotonic() - saved > 60 * config.checkpoint_minutes:
                run.save()
                saved = time.monotonic()
            if validation_is_due(run):
                check()


def one_step(run: Run, network: nn.Module, batch: Batch, rate: float, dtype: torch.dtype | None) -> dict[str, float]:
    """One step of the optimizer and of the averaged weights. network: run.model, or what wraps it.

    Returns loss, grad (its norm before clipping), lr and the terms of the loss. Raises FloatingPointError, in every
    process, if loss or gradient are not finite in one of them.
    """
    for group in run.optimizer.param_groups:
        group["lr"] = rate
    run.optimizer.zero_grad(set_to_none=True)
    loss, terms = backward(network, batch, run.config, dtype)
    norm = nn.utils.clip_grad_norm_(run.model.parameters(), run.config.clip)
    if agree([float(not is_finite(loss, norm))], run.device, run.world)[0]:
        kept = f"{run.checkpoint} holds the last good state" if run.checkpoint.is_file() else "nothing is saved yet"
        raise FloatingPointError(f"loss or gradient is not finite at step {run.step}; {kept}; try a lower --lr")
    run.optimizer.step()
    run.step += 1
    run.average()
    values = {"loss": float(loss), "grad": float(norm), "lr": rate}
    return values | {name: float(value) for name, value in terms.items()}


def backward(
    network: nn.Module, batch: Batch, config: TrainConfig, dtype: torch.dtype | None
) -> tuple[Tensor, dict[str, Tensor]]:
    """Add the gradient of a batch, in --accumulate parts: the mean of the parts' gradients, each of its own loss.

    dtype: of the network's forward pass; None: float32. Returns the mean loss and its terms, detached.
    """
    parts = batch.split(config.accumulate)
    losses, all_terms = [], []
    for number, part in enumerate(parts):
        more = number + 1 < len(parts)  # processes exchange the sum, once
        shared = isinstance(network, nn.parallel.DistributedDataParallel)
        with network.no_sync() if more and shared else nullcontext():  # type: ignore[operator]
            with autocast(part.left.device, dtype):
                output = network(part.left, part.right, part.target.camera)
            loss, terms = total_loss(output, part.target, config.loss)
            (loss / len(parts)).backward()
        losses.append(loss.detach())
        all_terms.append(terms)
    mean = {name: torch.stack([terms[name] for terms in all_terms]).mean() for name in all_terms[0]}
    return torch.stack(losses).mean(), mean


def named(config: TrainConfig) -> str:
    """The dataset folders, as they were given."""
    return " ".join(map(str, config.data))


def closing_words(run: Run, validations: list[dict[str, Any]]) -> str:
    """What a finished run says: what it wrote, how good that is, and how it is scored."""
    known = [record for record in validations if record["epe"] is not None]
    quality = "not validated"
    if known:
        last, best = known[-1], min(known, key=lambda record: record["epe"])
        normals = "" if last["normal"] is None else f", normals {last['normal']:.1f} deg"
        quality = f"EPE {last['epe']:.3f} px, Abs Rel {last['abs_rel']:.4f}{normals} on val"
        if best["epe"] < last["epe"]:
            quality += f" (best EPE {best['epe']:.3f} px at step {best['step']})"
    weights = run.config.out / "weights.safetensors"
    lines = [f"{weights}: averaged weights of step {run.step}, {run.seconds / 60:.1f} min; {quality}"]
    for number, folder in enumerate(run.config.data, start=1):
        words = ["--data", folder, *run.config.reader.flags(), "--split", "test", "--weights", weights]
        if not holds_test_pairs(run.config, folder):
            lines.append(f"{folder}: split test holds no pairs to score them on; more scenes would have some")
            continue
        out = run.config.out / ("score" if number == 1 else f"score-{number}")
        lines.append(f"score them: python -m m3depth.evaluate {shlex.join(map(str, [*words, '--out', out]))}")
    if (run.config.out / CURVES).is_file():
        lines.insert(1, f"{run.config.out / CURVES}: curves of the loss and the validations")
    return "\n".join(lines)


def holds_test_pairs(config: TrainConfig, folder: Path) -> bool:
    """Whether a folder's split test is worth naming; so it is where that cannot be known, of pairs from elsewhere."""
    try:
        return len(open_pairs(folder, "test", config.reader)) > 0
    except (ValueError, OSError):
        return True


def check_common_step(run: Run) -> None:
    """Raise ValueError, in every process, if they have not all resumed from one checkpoint."""
    last, behind = map(int, agree([run.step, -run.step], run.device, run.world))
    if last != -behind:
        raise ValueError(
            f"--out {run.config.out}: the processes stand at steps {-behind} to {last}; it must be a folder that all "
            "machines share"
        )


def is_finite(loss: Tensor, norm: Tensor) -> bool:
    """Whether a step may be taken."""
    return bool(torch.isfinite(loss) & torch.isfinite(norm))
