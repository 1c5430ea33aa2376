"""The flags of m3depth.train, and their checks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import zip_longest
from pathlib import Path
from typing import Annotated, Literal

import tyro

from m3depth.datasets.config import DataConfig
from m3depth.kinds.config import PresetName
from m3depth.network.device import DeviceName, check_device
from m3depth.training.augmentation import AugmentConfig
from m3depth.training.loss_config import LossConfig

LIMITS: dict[str, tuple[float, float]] = {  # least and largest values, beyond which no training makes sense
    "max_minutes": (0, 1e7), "max_steps": (0, 1e9), "epochs": (0, 1e6), "batch": (0, 4096), "accumulate": (0, 4096),
    "lr": (0, 10), "clip": (0, 1e6), "loader_threads": (0, 256), "checkpoint_minutes": (0, 1e6),
    "weight_decay": (0, 10), "validate_every": (0, 1e9), "validate_samples": (0, 1e6),
}  # fmt: skip
MAY_BE_ZERO = ("weight_decay", "validate_every", "validate_samples")
LARGEST_CROP = 1 << 14  # [px]
COARSEST = 8  # side of a cell of the coarsest grid on which the loss is computed [px]
Recipe = Literal["own", "paper"]


@dataclass(frozen=True)
class TrainConfig:
    """Settings of a training run. Give --max-steps, --epochs, --max-minutes, or several (the first ends it)."""

    data: tuple[Path, ...]
    """Dataset folders, of marssim.generate or of a layout that --format lists.
    Several are trained on as one. Where other layouts are among them, the flags of the reader, --format to
    --depth-range, are for those, and datasets of marssim are read without them.
    """
    out: Path
    """Folder of the run, for its checkpoint, weights, log, curves and image panels."""
    reader: Annotated[DataConfig, tyro.conf.arg(name="")] = field(default_factory=DataConfig)
    """Settings of the dataset reader."""
    preset: PresetName = "lite"
    """Network: lite is M3Depth for a CPU, paper has the sizes of the paper's tables, paper-thin its parts at the widths
    of lite. The others are methods that it is compared with, at a width for a CPU and, with -published, at the
    published one.
    """
    network: Path | None = None
    """JSON file with the sizes of the network, such as weights.json beside any weights.
    It replaces --preset.
    """
    recipe: Recipe = "own"
    """Defaults of the other flags: own are those that this help shows; paper sets --lr 1e-4, --schedule constant,
    --batch 12, --crop 512 512, --initial normal, --loss.depth, --loss.confidence 1e-4 and --loss.sky 1.5e-4, and no
    augmentation, weight decay, clipping, averaging or weights of pixels. Any other flag still overrides its default.
    """
    max_minutes: float | None = None
    """Time budget [min], above 0; a resumed run counts the time that it has spent before.
    The schedule of the learning rate is fitted to it.
    """
    max_steps: int | None = None
    """Number of optimizer steps, 1 or more, including those of the run before it was resumed.
    The schedule of the learning rate is fitted to it.
    """
    epochs: int | None = None
    """Number of passes over the data, 1 to 1000000, another form of --max-steps."""
    init: Path | None = None
    """Weights to start from: a .safetensors file, or the word shipped for those of the package.
    The network is theirs; another one in --network, or in --preset but for its default, is refused.
    """
    depth_weights: Path | None = None
    """Weights of M3Depth that give the depth to --preset fusion and geo-net, a .safetensors file; without it, those of
    the package. The run's weights name the path as given and the file's SHA-256, and need it wherever they are used.
    """
    batch: int = 4
    """Crops in a step, 1 to 4096; under torchrun, of each process."""
    accumulate: int = 1
    """Parts in which the crops of a step pass through the network one after the other.
    More parts need less memory; --batch must be a multiple.
    """
    recompute: bool = False
    """Keep few activations and compute the others twice: less memory, the same gradients, a third slower."""
    precision: Literal["auto", "fp32", "bf16"] = "auto"
    """Precision of the network in training; auto is bf16 where the device computes in it, else fp32."""
    crop: tuple[int, int] = (256, 448)
    """Height and width of the crops [px], multiples of 8, up to 16384.
    Multiples of 32 (64 with --preset paper, paper-thin, hit-net and uni-mvs-net) need no padding.
    """
    lr: float = 8e-4
    """Highest learning rate, above 0 and at most 10. With --init, use a quarter of it or less."""
    schedule: Literal["cycle", "constant"] = "cycle"
    """Course of the learning rate: cycle rises to --lr and falls to a hundredth of it, constant stays at --lr."""
    initial: Literal["own", "normal"] = "own"
    """Weights of a new network: own are those of its parts; normal draws those of all convolutions and linear layers
    from normal distributions whose variance is 2 over the number of inputs (He et al.), also those that start small for
    a purpose. Biases are then 0, and scales of normalisations 1. A network of --init keeps its weights.
    """
    weight_decay: float = 1e-4
    """Weight decay of the optimizer, AdamW, 0 to 10; without, it is Adam."""
    clip: float = 1.0
    """Largest norm of the gradient, above 0; larger ones are scaled down to it."""
    ema: float = 0.998
    """Decay of the averaged weights at each step, at least 0 and less than 1; they are what is saved and validated.
    0 saves the current weights without averaging.
    """
    seed: int = 0
    """Seed of the initial weights, the order of the samples and the augmentation, 0 to 2^63 - 1."""
    loss: LossConfig = field(default_factory=LossConfig)
    """Weights of the loss terms."""
    augment: AugmentConfig = field(default_factory=AugmentConfig)
    """Random changes of the crops."""
    cache: bool = True
    """Keep decoded samples in memory: up to half of the free memory, and a quarter for validation."""
    loader_threads: int = 1
    """Number of background threads that prepare batches, 1 to 256."""
    checkpoint_minutes: float = 5.0
    """Time between checkpoints [min], above 0."""
    validate_every: int = 500
    """Steps between validations, each with an image panel; with 0, the run is validated only at its end."""
    validate_samples: int = 16
    """Number of pairs of the val split that a validation scores; 0 turns validation off."""
    device: DeviceName = "auto"
    """Device that trains: auto is a GPU if there is one, else the CPU."""


PAPER_LOSS = LossConfig(
    depth=True, rock=1.0, edge=1.0, one_eye=1.0, rover=1.0, sky_disparity=0.0, confidence=1e-4, sky=1.5e-4,
)  # fmt: skip
"""The paper's loss (Sec. V-A), and the two decisions that its network does not have, of the sky and of the confidence,
since evaluation needs them. Depth over 15 m makes L_d some 2000 times smaller than it is in pixels, and so are the
weights of the decisions, or they would train the parts that they share with the depth. Adam trains their own layers all
the same: it does not see the scale of a gradient.
"""
NO_CHANGES = AugmentConfig(
    contrast=1.0, brightness=0.0, gamma=0.0, eye_gain=0.0, noise=0.0, blur=0.0, grey=0.0, vertical=0.0, occlude=0.0,
    bottom=0.0, scale=0.0,
)  # fmt: skip
PAPER = TrainConfig(
    data=tyro.MISSING, out=tyro.MISSING, recipe="paper", lr=1e-4, schedule="constant", batch=12, crop=(512, 512),
    initial="normal", weight_decay=0.0, clip=1e6, ema=0.0, loss=PAPER_LOSS, augment=NO_CHANGES,
)  # fmt: skip
"""The defaults of --recipe paper (Sec. V-B). The paper names neither crops nor clipping nor averaged weights."""
RECIPES: dict[Recipe, TrainConfig] = {"own": TrainConfig(data=tyro.MISSING, out=tyro.MISSING), "paper": PAPER}
"""The defaults of each --recipe; in Python, replace(RECIPES["paper"], data=..., out=...). Alone, the field `recipe`
changes nothing.
"""


def recipe_defaults(args: Sequence[str]) -> TrainConfig | None:
    """Return the defaults that the flag --recipe of a command line chooses; None for those of TrainConfig.

    Args:
        args: The command line.
    """
    chosen = None
    for word, after in zip_longest(args, args[1:]):
        if word == "--recipe":
            chosen = after
        elif word.startswith("--recipe="):
            chosen = word.removeprefix("--recipe=")
    return PAPER if chosen == "paper" else None


def in_steps(config: TrainConfig, samples: int, world: int) -> TrainConfig:
    """Return a config whose max_steps are the fewer of --epochs and --max-steps; epochs stays only if it gave them.

    Args:
        config: The flags of the run.
        samples: Number of samples in an epoch.
        world: Number of processes that share the batches of a step.
    """
    if config.epochs is None:
        return config
    steps = math.ceil(config.epochs * samples / (config.batch * world))
    if config.max_steps is not None and config.max_steps < steps:
        return replace(config, epochs=None)
    return replace(config, max_steps=steps)


def check_config(config: TrainConfig) -> None:
    """Raise ValueError that names the flag of a setting that cannot work."""
    if not config.data:
        raise ValueError("--data: name at least one dataset folder")
    if config.init and config.depth_weights:
        raise ValueError(f"--depth-weights {config.depth_weights}: the weights of --init name those of their depth")
    if config.max_minutes is None and config.max_steps is None and config.epochs is None:
        raise ValueError("give --max-minutes, --max-steps or --epochs")
    for name, (low, high) in LIMITS.items():
        value = getattr(config, name)
        if value is not None and not (low <= value <= high and (value > 0 or name in MAY_BE_ZERO)):
            beyond = f"{low:g} to {high:g}" if name in MAY_BE_ZERO else f"above 0 and at most {high:g}"
            raise ValueError(f"--{name.replace('_', '-')} must be {beyond}, got {value:g}")
    if config.batch % config.accumulate:
        raise ValueError(f"--accumulate {config.accumulate}: --batch {config.batch} is not a multiple of it")
    if not 1 <= min(config.crop) <= max(config.crop) <= LARGEST_CROP or any(side % COARSEST for side in config.crop):
        raise ValueError(
            f"--crop {config.crop[0]} {config.crop[1]}: both must be multiples of {COARSEST}, up to {LARGEST_CROP}"
        )
    if not 0 <= config.seed < 1 << 63:
        raise ValueError(f"--seed must be 0 to 2^63 - 1, got {config.seed}")
    if not 0 <= config.ema < 1:
        raise ValueError(f"--ema must be at least 0 and less than 1, got {config.ema}")
    check_device(config.device)
