"""The training loop behind `python -m m3depth.train`."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager, nullcontext, suppress

import torch
from torch import Tensor, nn

from m3depth.datasets.state import state_of_pairs
from m3depth.network.device import autocast, fast_dtype
from m3depth.network.output import StereoOutput
from m3depth.network.stereo_network import StereoNetwork
from m3depth.stereo.pairs import StereoPairs
from m3depth.training.batch import Batch, network_inputs
from m3depth.training.config import TrainConfig, check_config, in_steps
from m3depth.training.curves import save_curves
from m3depth.training.ending import loss_fault, share_done, spent_budget, weight_fault
from m3depth.training.log import Log, records
from m3depth.training.losses import total_loss
from m3depth.training.messages import announce, data_names, progress_text, summary
from m3depth.training.process_group import agree, entered_by_first, joined_group
from m3depth.training.run import Run, learning_rate
from m3depth.training.samples import PackedCache, batches, check_crops, check_labels, warnings_of
from m3depth.training.validation import PANELS, Validator
from marssim.base.command.run import is_out_of_memory
from marssim.base.command.signals import stop_on_signal
from marssim.base.compute.free_memory import free_memory
from marssim.base.compute.one_thread import one_opencv_thread
from marssim.base.results.claim import PARTIAL, ResultFolder

LOWER_RATE = "; try a lower --lr"  # the end of the message on a training that has diverged


def train(config: TrainConfig, samples: StereoPairs, held_out: StereoPairs) -> dict[str, float]:
    """Train until the budget is spent or a signal comes; both leave a checkpoint that the same call continues.

    Signals (stop_on_signal) stop a training that is called from the main thread.

    Args:
        config: The run, its folder and its budget.
        samples: Stereo samples to train on (fields as in marssim.base.dataset.dataset).
        held_out: Samples to validate on; without any, nothing is validated.

    Returns:
        The last validation of the averaged weights; empty without `held_out`, where the run was done before, and after
        a signal under torchrun, which would report an error of one of its processes with a traceback.

    Raises:
        ValueError: Bad settings.
        FolderInUse: Another command writes to the folder of the run.
        FloatingPointError: The loss is not finite; the last checkpoint stays as it was.
        KeyboardInterrupt: After a signal, once the run is saved; not under torchrun.
    """
    check_config(config)
    folder = ResultFolder(config.out, "training run", partial=(PARTIAL, f"{PANELS}/{PARTIAL}"))
    folder.check()
    if not len(samples):
        raise ValueError(f"{data_names(config)}: split train holds no pairs; name another folder with --data")
    with (
        one_opencv_thread(),
        joined_group(config.device) as (rank, world, device),
        entered_by_first(rank, world, folder.claim()),
    ):
        config = in_steps(config, len(samples), world)
        run = Run(config, device, world)
        resumed, data = run.resume(), str(state_of_pairs(samples))
        run.note_data(data)
        check_common_step(run)
        if budget := spent_budget(config, run.step, run.seconds):
            return report_spent_budget(run, budget, held_out) if rank == 0 else {}
        local = int(os.environ.get("LOCAL_WORLD_SIZE", 1))
        cache = PackedCache(samples, free_memory() // 2 // local if config.cache else 0)
        check_crops(cache, samples, config.crop)  # before anything is written
        check_labels(cache, samples)
        with ExitStack() as opened:
            log = opened.enter_context(closing(Log(config.out, run.step))) if rank == 0 else None
            if log:
                announce(run, resumed, len(samples), len(held_out))
                for warning in warnings_of(cache, samples, config.reader.normals == "depth"):
                    log.say(f"warning: {warning}")
                log.start(run.step, config.seed, data, world)
            stream = opened.enter_context(
                closing(
                    batches(
                        cache, run.step, config.batch, config.crop, config.augment, config.seed, rank, world,
                        config.loader_threads,
                    )
                )
            )  # fmt: skip
            validator = Validator(run, log, held_out)
            if log and resumed and validation_is_due(run) and not is_validated(run):
                validator.validate()
            stopped = take_steps(run, stream, log, validator)
            scores = finish(run, log, validator, stopped) if log else {}
            if stopped and "LOCAL_RANK" not in os.environ:
                raise KeyboardInterrupt
            return scores


def report_spent_budget(run: Run, budget: str, held_out: StereoPairs) -> dict[str, float]:
    """Report that a run's budget is spent. First do what a kill between its last step and its end left undone.

    Args:
        run: The run.
        budget: The flag and value of the spent budget.
        held_out: Pairs to validate on; there may be none.
    """
    if len(held_out) and run.config.validate_samples and not is_validated(run):
        with closing(Log(run.config.out, run.step)) as log:
            return finish(run, log, Validator(run, log, held_out), stopped=False)
    save_curves(run.config.out)
    minutes = run.seconds / 60
    print(f"{run.config.out}: already at {budget} (step {run.step}, {minutes:.1f} min); raise it to go on")
    return {}


def validation_is_due(run: Run) -> bool:
    """Tell whether a validation follows the step that the run has just taken."""
    every = run.config.validate_every
    return every > 0 and run.step > 0 and run.step % every == 0


def is_validated(run: Run) -> bool:
    """Tell whether the log has a validation of the run's present step."""
    return any(record["step"] == run.step for record in records(run.config.out, "val"))


def finish(run: Run, log: Log, validator: Validator, stopped: bool) -> dict[str, float]:
    """Validate a run that is done, draw its curves and report it, or report one that a signal stopped.

    Args:
        run: The run.
        log: Its log.
        validator: Validates it.
        stopped: Whether a signal stopped it.

    Returns:
        The scores of a run that is done.
    """
    scores = {} if stopped else validator.validate()
    save_curves(run.config.out)
    if stopped:
        log.say(f"stopped at step {run.step}, and saved it")
        return {}
    log.say("done")
    print(summary(run, records(run.config.out, "val")), flush=True)
    return scores


def take_steps(run: Run, stream: Iterator[Batch], log: Log | None, validator: Validator) -> bool:
    """Take steps until the budget is spent or a signal comes, and save the run.

    Args:
        run: The run.
        stream: Its batches.
        log: The log of rank 0, which saves checkpoints and validates; None in the other processes.
        validator: Validates the run.

    Returns:
        Whether a signal stopped it.
    """
    config, device, world = run.config, run.device, run.world
    network: nn.Module = run.model
    if world > 1:
        network = nn.parallel.DistributedDataParallel(run.model, [device.index] if device.type == "cuda" else None)
    dtype = {"auto": fast_dtype(device), "fp32": None, "bf16": torch.bfloat16}[config.precision]
    run.model.recompute = config.recompute
    spent_before, began, saved = run.seconds, time.monotonic(), time.monotonic()
    used_before = time.process_time()
    waited, batch = 0.0, None
    with stop_on_signal() as signals:
        while True:
            # All processes must decide alike: the clock is that of rank 0; a signal or a NaN counts from any of them.
            run.seconds = spent_before + time.monotonic() - began
            clock, stopped = agree([run.seconds if log else 0.0, float(bool(signals))], device, world)
            done = share_done(config, run.step, clock)
            if stopped or done >= 1:
                if batch is not None:
                    check_state(run, batch, dtype, world)
                    if log:
                        log.stop(run.step, times_of(run, used_before))
                if log and (batch is not None or not run.checkpoint.is_file()):
                    run.save()
                return bool(stopped)
            before = time.monotonic()
            try:
                next_batch = next(stream)
            except (ValueError, OSError):  # a broken pair: the steps until here are not lost
                with suppress(FloatingPointError, OSError):
                    if log and batch is not None:
                        check_state(run, batch, dtype)
                        run.save()
                raise
            batch = next_batch.to(device)
            waited += time.monotonic() - before
            with memory_errors_explained(config):
                values = one_step(run, network, batch, learning_rate(config.lr, done, config.schedule), dtype)
            run.seconds = spent_before + time.monotonic() - began
            if log is None:
                continue
            if run.step % 10 == 0 or run.step == 1:
                share = waited / max(time.monotonic() - began, 1e-9)
                log.write("train", run.step, values | times_of(run, used_before) | {"loader_share": share})
            log.progress(progress_text(run, values))
            due = validation_is_due(run)
            if due or time.monotonic() - saved > 60 * config.checkpoint_minutes:
                check_state(run, batch, dtype)
                run.save()
                saved = time.monotonic()
            if due and not signals:  # it may take longer than what stops the run waits; a resumed run makes up for it
                validator.validate()


@contextmanager
def memory_errors_explained(config: TrainConfig) -> Iterator[None]:
    """Turn an error of PyTorch for lack of memory in a step into a MemoryError that says which flag reduces it."""
    try:
        yield
    except RuntimeError as error:
        if not is_out_of_memory(error):
            raise
        reason = str(error).partition("\n")[0]
        more = next((n for n in range(config.accumulate + 1, config.batch + 1) if config.batch % n == 0), None)
        advice = f"take the {config.batch} crops of a step in more parts, with --accumulate {more}"
        if more is None:
            advice = f"{'' if config.recompute else 'add --recompute, or '}take smaller crops with --crop"
        raise MemoryError(f"{advice}; {reason}") from None


def times_of(run: Run, used_before: float) -> dict[str, float]:
    """Return the minutes of a run, and those that this process has used its processors for since the start.

    Args:
        run: The run.
        used_before: Processor time of the process at the start [s].
    """
    return {"minutes": run.seconds / 60, "processor_minutes": (time.process_time() - used_before) / 60}


def one_step(run: Run, network: nn.Module, batch: Batch, rate: float, dtype: torch.dtype | None) -> dict[str, float]:
    """Take one step of the optimizer and of the averaged weights.

    Args:
        run: The run.
        network: run.model, or its DistributedDataParallel.
        batch: The crops.
        rate: Learning rate.
        dtype: Precision of the network's forward pass; None is float32.

    Returns:
        loss, grad (norm before clipping), lr and the terms of the loss.

    Raises:
        FloatingPointError: In every process, if loss or gradient is not sound in one of them.
    """
    for group in run.optimizer.param_groups:
        group["lr"] = rate
    run.optimizer.zero_grad(set_to_none=True)
    loss, terms = backward(network, batch, run.config, dtype)
    norm = nn.utils.clip_grad_norm_(run.model.parameters(), run.config.clip)
    fault = loss_fault(loss, run.config.loss) or (None if torch.isfinite(norm) else "gradient is not finite")
    raise_if_diverged(fault, run, run.world)
    run.optimizer.step()
    run.step += 1
    run.average()
    values = {"loss": float(loss), "grad": float(norm), "lr": rate}
    return values | {name: float(value) for name, value in terms.items()}


def check_state(run: Run, batch: Batch, dtype: torch.dtype | None, world: int = 1) -> None:
    """Check the weights after a step, which no loss has seen yet, before they are saved.

    Args:
        run: The run after a step.
        batch: The samples of that step; the loss on them must be sound.
        dtype: Type of the forward pass; None: float32.
        world: Number of processes that check together.

    Raises:
        FloatingPointError: The training has diverged, in any of the processes.
    """
    fault = weight_fault(run.model)
    if fault is None:
        for part in batch.split(run.config.accumulate):  # the whole batch need not fit into memory
            with torch.no_grad(), autocast(part.left.device, dtype):
                output = run.model(*network_inputs(part, run.model.takes_truth))
            fault = fault or loss_fault(total_loss(output, part.target, run.config.loss)[0], run.config.loss)
    raise_if_diverged(fault, run, world)


def raise_if_diverged(fault: str | None, run: Run, world: int) -> None:
    """Raise FloatingPointError in every process if there is a fault in one of them.

    Args:
        fault: What is wrong in this process; None if nothing is.
        run: The run.
        world: Number of processes.
    """
    if agree([float(fault is not None)], run.device, world)[0]:
        kept = f"{run.checkpoint} holds the last good state" if run.checkpoint.is_file() else "nothing is saved yet"
        reason = fault or "loss, gradient or weights of another process are not sound"
        raise FloatingPointError(f"training has diverged: {reason} at step {run.step}; {kept}{LOWER_RATE}")


def backward(
    network: nn.Module, batch: Batch, config: TrainConfig, dtype: torch.dtype | None
) -> tuple[Tensor, dict[str, Tensor]]:
    """Add the gradient of a batch, in --accumulate parts: the mean of the parts' gradients, each of its own loss.

    The loss of a band at full resolution is added to that of its reduced crop, for networks that go on there.

    Args:
        network: Takes left and right images and cameras.
        batch: The crops.
        config: Settings of the run.
        dtype: Precision of the network's forward pass; None is float32.

    Returns:
        The mean loss and its terms, detached.
    """
    parts = batch.split(config.accumulate)
    losses, all_terms = [], []
    for number, part in enumerate(parts):
        last = number + 1 == len(parts)  # the processes exchange their gradients once, at the last part
        shared = isinstance(network, nn.parallel.DistributedDataParallel)
        with network.no_sync() if shared and not last else nullcontext():  # type: ignore[operator]
            with autocast(part.left.device, dtype):
                output = network(*network_inputs(part, plain(network).takes_truth))
            loss, terms = total_loss(output, part.target, config.loss)
            if part.finer and plain(network).TAKES_START:
                finer = finer_losses(network, output, part, config, dtype)
                loss = loss + finer.sum() / len(part.left)
                terms["finer"] = finer.detach().mean()
            (loss / len(parts)).backward()
        losses.append(loss.detach())
        all_terms.append(terms)
    names = {name: None for terms in all_terms for name in terms}
    mean = {name: torch.stack([terms[name] for terms in all_terms if name in terms]).mean() for name in names}
    return torch.stack(losses).mean(), mean


def plain(network: nn.Module) -> StereoNetwork:
    """Return the network inside a DistributedDataParallel, or the one that is given."""
    inner = network.module if isinstance(network, nn.parallel.DistributedDataParallel) else network
    assert isinstance(inner, StereoNetwork)
    return inner


def finer_losses(
    network: nn.Module, output: StereoOutput, batch: Batch, config: TrainConfig, dtype: torch.dtype | None
) -> Tensor:
    """Return the losses (N,) of the N bands of a batch at full resolution, where the refinement goes on.

    Args:
        network: See backward.
        output: What it returned for the crops of the batch.
        batch: The crops.
        config: Settings of the run.
        dtype: Precision of the forward pass; None is float32.
    """
    # The hooks of DistributedDataParallel sit on the parameters, and its forward has prepared them: its module may be
    # called directly.
    model = plain(network)
    losses = []
    for band in batch.finer:
        start = output.pair(band.crop).start(*band.size).rows(band.top, band.left.shape[-2])
        with autocast(band.left.device, dtype):
            finer = model(band.left, band.right, band.target.camera, start)
        losses.append(total_loss(finer, band.target, config.loss)[0])
    return torch.stack(losses)


def check_common_step(run: Run) -> None:
    """Raise ValueError, in every process, unless all of them have resumed from the same checkpoint."""
    last, first = map(int, agree([run.step, -run.step], run.device, run.world))
    if last != -first:
        raise ValueError(
            f"--out {run.config.out}: the processes resumed at steps {-first} to {last}; it must be a folder that all "
            "machines share"
        )
