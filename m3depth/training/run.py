"""The state of a training run, and its checkpoint."""

from __future__ import annotations

import copy
import hashlib
import io
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import torch

from m3depth.kinds.config import NetworkConfig, config_from_dict, preset_config, read_config
from m3depth.kinds.networks import draw_normal, load_network, new_network
from m3depth.network.device import fast_dtype
from m3depth.network.model import M3Depth
from m3depth.network.stereo_network import StereoNetwork
from m3depth.rivals.config import SOURCES, NormalConfig
from m3depth.rivals.normal_network import with_depth_weights
from m3depth.training.config import PAPER_LOSS, TrainConfig
from m3depth.training.loss_config import LossConfig
from m3depth.weights import SHIPPED, SHIPPED_WEIGHTS, named_by, weights_file
from marssim.base.command.run import is_out_of_memory
from marssim.base.files.atomic import write_atomically
from marssim.base.files.json_file import as_json
from marssim.base.results.claim import as_typed, differences

WARM_UP = 0.04  # share of the run in which the learning rate rises
FIRST_RATE, LAST_RATE = 0.05, 0.01  # of the highest learning rate
CHECKPOINT = "checkpoint.pt"  # name of the checkpoint in a run's folder
FEW = 3  # differences that a message lists
MOST_STEPS = 10**15  # a larger number of steps is none
WORLD = "number of processes"  # its name in a run's identity
CHANGEABLE = (  # fields that may change when a run is resumed, beside those of loss, augmentation and reader
    "max_minutes", "max_steps", "epochs", "lr", "schedule", "weight_decay", "clip", "ema", "accumulate", "precision",
    "data", "validate_samples",
)  # fmt: skip


def first_network(config: TrainConfig) -> StereoNetwork:
    """Return the network that a run starts from.

    A run that goes on from --init gets a network of its checkpoint's sizes, with any weights: the file of --init may be
    gone by now, and the checkpoint replaces the weights.

    Raises:
        FileNotFoundError: The file of --init, --network or --depth-weights is missing.
        ValueError: That file cannot be used; the message names it. Or the network takes no depth of M3Depth, or --init
            has the weights of another network than --preset or --network.
    """
    previous = config.out / CHECKPOINT
    if config.init and previous.is_file():
        first = config_from_dict(read_checkpoint(previous)["identity"]["network"])
        _check_same_network(first, config)
        return new_network(first)
    if config.init:
        with named_by("--init"):
            loaded = load_network(weights_file(config.init))
        _check_same_network(loaded.config, config)
        return loaded
    sizes = read_config(config.network) if config.network else preset_config(config.preset)
    if config.depth_weights:
        if not isinstance(sizes, NormalConfig) or sizes.true_depth:
            raise ValueError(f"--depth-weights {config.depth_weights}: this network takes no depth from M3Depth")
        with named_by("--depth-weights"):
            sizes = with_depth_weights(sizes, config.depth_weights)
    network = new_network(sizes)
    if config.initial == "normal":
        draw_normal(network)
    return network


def _check_same_network(first: NetworkConfig, config: TrainConfig) -> None:
    """Raise ValueError if a flag names another network than that of the weights of --init.

    The default of --preset names none. Weights of a network for normals name the file of their depth, flags do not.
    """
    if config.network:
        flag, named = f"--network {config.network}", read_config(config.network)
    elif config.preset != TrainConfig.preset:
        flag, named = f"--preset {config.preset}", preset_config(config.preset)
    else:
        return
    if isinstance(first, NormalConfig) and isinstance(named, NormalConfig):
        named = replace(named, depth_weights=first.depth_weights, depth_sha256=first.depth_sha256)
    sizes, others = ({"kind": network.KIND, **as_json(network.to_dict())} for network in (first, named))
    if other := differences(sizes, others if first.KIND == named.KIND else {**sizes, "kind": named.KIND}):
        shown = "; ".join(other[:FEW]) + (f"; and {len(other) - FEW} more" if len(other) > FEW else "")
        raise ValueError(f"{flag}: the weights of --init are of another network: {shown}; leave one of the two out")


def check_loss(network: StereoNetwork, config: TrainConfig) -> None:
    """Raise ValueError if the loss of another method than M3Depth, which has its own, is to be changed by flags."""
    if not isinstance(network, M3Depth) and config.loss not in (LossConfig(), PAPER_LOSS):
        raise ValueError(f"--loss.*: {network.config.KIND} is trained with its own loss; these flags are M3Depth's")


def origin(init: Path) -> str:
    """Return the value of --init as a run's identity has it: "shipped", or the resolved path of another file.

    The file of the shipped weights counts as "shipped" too: the package may be elsewhere when the run is resumed, and
    checkpoints of release 0.1 have its path.
    """
    file = weights_file(init).resolve()
    return SHIPPED if file == SHIPPED_WEIGHTS.resolve() else str(file)


def saved_progress(out: Path) -> tuple[int, float]:
    """Return steps and seconds of the checkpoint in a run folder; zeros without one.

    Raises:
        ValueError: The checkpoint is damaged.
    """
    path = out / CHECKPOINT
    if not path.is_file():
        return 0, 0.0
    state = read_checkpoint(path)
    return state["step"], state["seconds"]


def read_checkpoint(path: Path) -> dict[str, Any]:
    """Read what Run.save wrote, to the CPU, where AdamW keeps its count of steps. Nothing in the file is executed.

    Args:
        path: The file.

    Raises:
        ValueError: The file is damaged; the message names it.
    """
    with _naming(path):
        state = torch.load(path, map_location="cpu", weights_only=True)
        sizes = dict(state["identity"]["network"])
    try:
        network = config_from_dict(sizes)
    except ValueError as error:  # of a network of one's own that is not known here, or whose sizes have changed
        raise ValueError(f"{path}: {error}") from None
    with _naming(path):
        # The first checkpoints lack the number of processes and some fields of the network.
        state["identity"] = {WORLD: 1, **state["identity"], "network": as_json(network.to_dict())}
        if state["identity"].get("init") is not None:  # the first checkpoints have it as it was typed
            state["identity"]["init"] = origin(Path(state["identity"]["init"]))
        if type(state["step"]) is not int or not 0 <= state["step"] <= MOST_STEPS:
            raise ValueError("no number of steps")
        if type(state["seconds"]) not in (int, float) or not 0 <= state["seconds"] < math.inf:
            raise ValueError("no time")
    return state


@contextmanager
def _naming(path: Path, another_source: bool = False) -> Iterator[None]:
    """Turn whatever a damaged checkpoint raises into a ValueError of one line that names it.

    Args:
        path: The checkpoint.
        another_source: Whether the source file of the network has changed since it was written.
    """
    try:
        yield
    except Exception as error:  # torch's unpickler and load_state_dict raise errors of many types
        if isinstance(error, MemoryError) or type(error).__name__ == "AcceleratorError" or is_out_of_memory(error):
            raise  # the file may be whole
        if another_source:
            raise ValueError(
                f"{path}: does not fit the network, whose source file has changed since; undo the change, or choose "
                "another --out"
            ) from None
        raise ValueError(
            f"{path}: not a readable checkpoint ({type(error).__name__}); delete it to start over, or choose another "
            f"--out and start with --init {path.parent / 'weights.safetensors'}"
        ) from None


class Run:
    """State of a training run.

    Args:
        config: Settings of the run.
        device: Device that trains.
        world: Number of processes that share the batches of a step.

    Attributes:
        model: The network that is trained.
        averaged: The averaged copy of it, which is saved and validated.
        optimizer: AdamW.
        step: Steps taken.
        seconds: Time spent [s].
        init_sha256: SHA-256 of the file of --init as the run began; None without one.
        data: What identifies the training pairs, as of state_of_pairs; None if that is not known.
        source: SHA-256 of the source file of a network that the program has added; None for those of the package.
        changed: How a resumed run differs from the one that it continues: flags with both values, other pairs, and
            another source of the network.
    """

    def __init__(self, config: TrainConfig, device: torch.device, world: int = 1) -> None:
        torch.manual_seed(config.seed)
        self.config, self.device, self.world = config, device, world
        self.model = first_network(config).to(device).train()
        check_loss(self.model, config)
        self.averaged = copy.deepcopy(self.model).eval().requires_grad_(False)
        self.optimizer = torch.optim.AdamW(self.model.parameters(), config.lr, weight_decay=config.weight_decay)
        self.step = 0
        self.seconds = 0.0
        self.init_sha256 = None if config.init is None else _sha256(weights_file(config.init))
        self.data: str | None = None
        self.source = _sha256(SOURCES.get(self.model.config.KIND))
        self.changed: list[str] = []

    @property
    def checkpoint(self) -> Path:
        """RUN/checkpoint.pt has everything that a resumed run needs; weights.safetensors beside it is for users."""
        return self.config.out / CHECKPOINT

    def average(self) -> None:
        """Move the averaged weights towards the current ones; faster at the start, when these still change a lot."""
        decay = min(self.config.ema, (1 + self.step) / (10 + self.step))
        with torch.no_grad():
            torch._foreach_lerp_(list(self.averaged.parameters()), list(self.model.parameters()), 1 - decay)

    def identity(self) -> dict[str, Any]:
        """Return the settings that a resumed run must share with the one that it continues."""
        c = self.config
        # The number of processes belongs to it because the samples of a step depend on it.
        return {
            "network": as_json(self.model.config.to_dict()), "batch": c.batch, "crop": list(c.crop), "seed": c.seed,
            WORLD: self.world, "init": None if c.init is None else origin(c.init), "initial": c.initial,
        }  # fmt: skip

    def settings(self) -> dict[str, str]:
        """Return the settings that may change when a run is resumed, as text, by flag."""
        c = self.config
        values: dict[str, Any] = {name: getattr(c, name) for name in CHANGEABLE}
        for part, config in (("loss", c.loss), ("augment", c.augment)):
            values |= {f"{part}.{name}": value for name, value in asdict(config).items()}
        values |= asdict(c.reader)
        values["device"] = self.device.type
        if c.precision == "auto":
            values["precision"] = "fp32" if fast_dtype(self.device) is None else "bf16"
        if c.epochs is not None:  # it gave the steps
            values["max_steps"] = None
        return {f"--{name.replace('_', '-')}": as_typed(value) for name, value in values.items()}

    def note_data(self, data: str) -> None:
        """Record what identifies the training pairs, and add to `changed` if they are not those of the checkpoint.

        Args:
            data: What identifies them, as of state_of_pairs.
        """
        if self.data not in (None, data):
            self.changed.append("the pairs in --data are others, or their files were moved or changed")
        self.data = data

    def save(self) -> None:
        """Write the averaged weights with their config, then the checkpoint, each atomically."""
        state = {
            "identity": self.identity(),
            "init_sha256": self.init_sha256,
            "settings": self.settings(),
            "model": self.model.state_dict(),
            "averaged": self.averaged.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "step": self.step,
            "seconds": self.seconds,
            "data": self.data,
            "source": self.source,
            "rng": torch.get_rng_state(),
        }
        buffer = io.BytesIO()
        torch.save(state, buffer)
        # The checkpoint comes last, so that it is never ahead of the weights, even if the process ends in between.
        self.averaged.save_pretrained(self.config.out / "weights.safetensors")
        write_atomically(self.checkpoint, buffer.getvalue())

    def resume(self) -> bool:
        """Continue from RUN/checkpoint.pt, if there is one; tell whether there is.

        Raises:
            ValueError: The checkpoint is damaged or belongs to another run.
        """
        if not self.checkpoint.is_file():
            return False
        state = read_checkpoint(self.checkpoint)
        identity, digest = self.identity(), state.get("init_sha256")  # checkpoints of earlier versions have no digest
        if digest is not None and digest == self.init_sha256:  # the same file, wherever it is now
            state["identity"]["init"] = identity["init"]
        # Checkpoints of earlier versions lack some of the settings.
        if other := differences({**identity, **state["identity"]}, identity):
            raise ValueError(f"{self.checkpoint}: belongs to a run with {'; '.join(other)}; choose another --out")
        another_source = None not in (state.get("source"), self.source) and state["source"] != self.source
        with _naming(self.checkpoint, another_source):
            self.model.load_state_dict(state["model"])
            self.averaged.load_state_dict(state["averaged"])
            # the settings of the optimizer are those of this run
            moments = {"state": state["optimizer"]["state"]}
            self.optimizer.load_state_dict({**self.optimizer.state_dict(), **moments})
            _check_moments(self.optimizer)
            before, now = state.get("settings", {}), self.settings()  # the first checkpoints lack them
            # earlier versions kept "auto" for the precision, whatever it was
            changes = [(flag, old) for flag, old in before.items() if now.get(flag, old) != old and old != "auto"]
            torch.set_rng_state(state["rng"])
        self.step, self.seconds = state["step"], state["seconds"]
        self.init_sha256, self.data = digest or self.init_sha256, state.get("data")
        self.changed = [f"{flag} {now[flag]} (was {old})" for flag, old in changes]
        if another_source:
            self.changed.append("the source file of the network has changed")
        return True


def _sha256(file: Path | None) -> str | None:
    """Return the SHA-256 of a file; None without one, and where it is gone, as a resumed run does not read it."""
    return None if file is None or not file.is_file() else hashlib.sha256(file.read_bytes()).hexdigest()


def _check_moments(optimizer: torch.optim.Optimizer) -> None:
    """Raise ValueError unless what AdamW keeps of each weight, if anything, fits the weight."""
    for weight, kept in optimizer.state.items():
        shapes = {"step": torch.Size(), "exp_avg": weight.shape, "exp_avg_sq": weight.shape}
        for name, shape in shapes.items():
            if not isinstance(kept.get(name), torch.Tensor) or kept[name].shape != shape:
                raise ValueError(f"{name} does not fit its weight")


def learning_rate(peak: float, progress: float, schedule: str = "cycle") -> float:
    """Return the learning rate of one cycle: a linear rise, then a cosine down to a hundredth. Or a constant one.

    Args:
        peak: Highest rate.
        progress: Share of the run that is done.
        schedule: "cycle" or "constant".
    """
    if schedule == "constant":
        return peak
    if progress < WARM_UP:
        return peak * (FIRST_RATE + (1 - FIRST_RATE) * progress / WARM_UP)
    fall = min(1.0, (progress - WARM_UP) / (1 - WARM_UP))
    return peak * (LAST_RATE + (1 - LAST_RATE) * 0.5 * (1 + math.cos(math.pi * fall)))
