"""Settings of a training run, and the check of them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from m3depth.datasets.config import DataConfig
from m3depth.training.augmentation import AugmentConfig
from m3depth.training.loss_config import LossConfig

COARSEST = 8  # [px] a cell of the coarsest grid on which the loss compares


@dataclass(frozen=True)
class TrainConfig:
    """Settings of a training run. Give --max-steps, --max-minutes, or both (whichever is reached first)."""

    data: tuple[Path, ...]
    """Dataset folders, of marssim.generate or of any layout that --format lists; several are trained on as one."""
    out: Path
    """Run folder: checkpoint, weights, log, panels."""
    reader: Annotated[DataConfig, tyro.conf.arg(name="")] = field(default_factory=DataConfig)
    """How the folders are read."""
    preset: Literal["lite", "paper"] = "lite"
    """Size of the network."""
    network: Path | None = None
    """The network's config as JSON, of the fields that stand beside any weights (weights.json), instead of --preset."""
    max_minutes: float | None = None
    """Time budget [min]; a resumed run counts what was spent before. The learning rate's schedule is fitted to it."""
    max_steps: int | None = None
    """Number of optimizer steps, those of a resumed run included. The learning rate's schedule is fitted to it."""
    init: Path | None = None
    """Start from these weights (.safetensors) instead of random ones; their config replaces --preset and --network."""
    batch: int = 4
    """Crops in a step, of each process under torchrun."""
    accumulate: int = 1
    """A step's crops go through the network in so many parts, one after the other: less memory for a larger batch."""
    recompute: bool = False
    """Keep few activations for the way back and compute the others anew: less memory, the same gradients, slower."""
    precision: Literal["auto", "fp32", "bf16"] = "auto"
    """Of the network while training; auto: bf16 where the device computes in it."""
    crop: tuple[int, int] = (256, 448)
    """Height and width of the crops [px], multiples of 8; those of 32 (64 for the paper preset) need no padding."""
    lr: float = 8e-4
    """Highest learning rate. Use a quarter of it or less with --init."""
    weight_decay: float = 1e-4
    """Weight decay of the optimizer, AdamW."""
    clip: float = 1.0
    """The gradient is scaled down to this norm where it is larger."""
    ema: float = 0.998
    """Decay a step of the averaged weights, which are what is saved; 0: no averaging."""
    seed: int = 0
    """Seed of initial weights, order and augmentation."""
    loss: LossConfig = field(default_factory=LossConfig)
    """Weights of the loss terms."""
    augment: AugmentConfig = field(default_factory=AugmentConfig)
    """How the images are changed."""
    cache: bool = True
    """Keep decoded samples in memory, up to half of what is free, those for validation up to a quarter."""
    loader_threads: int = 1
    """Background threads that make batches."""
    checkpoint_minutes: float = 5.0
    """Time between checkpoints [min]."""
    validate_every: int = 500
    """Steps between quick validations (and image panels); 0: none but the last."""
    validate_samples: int = 16
    """Pairs of the val split that a quick validation scores; 0: no validation."""
    device: Literal["auto", "cpu", "cuda"] = "auto"
    """auto: a GPU if there is one."""


def check_config(config: TrainConfig) -> None:
    """Raise ValueError that names the flag of a setting that cannot work."""
    if not config.data:
        raise ValueError("--data: name at least one dataset folder")
    if config.max_minutes is None and config.max_steps is None:
        raise ValueError("give --max-minutes, --max-steps or both")
    for name in (
        "max_minutes",
        "max_steps",
        "batch",
        "accumulate",
        "lr",
        "clip",
        "loader_threads",
        "checkpoint_minutes",
    ):
        value = getattr(config, name)
        if value is not None and not value > 0:
            raise ValueError(f"--{name.replace('_', '-')} must be positive, got {value}")
    for name in ("weight_decay", "validate_every", "validate_samples"):
        value = getattr(config, name)
        if not (math.isfinite(value) and value >= 0):
            raise ValueError(f"--{name.replace('_', '-')} must not be negative, got {value}")
    if config.batch % config.accumulate:
        raise ValueError(f"--accumulate {config.accumulate}: --batch {config.batch} is no multiple of it")
    if min(config.crop) < 1 or any(side % COARSEST for side in config.crop):
        raise ValueError(f"--crop {config.crop[0]} {config.crop[1]}: both must be multiples of {COARSEST}")
    if not 0 <= config.seed < 1 << 63:
        raise ValueError(f"--seed must be 0 to 2^63 - 1, got {config.seed}")
    if not 0 <= config.ema < 1:
        raise ValueError(f"--ema must be at least 0 and less than 1, got {config.ema}")
    if config.device not in ("auto", "cpu", "cuda"):
        raise ValueError(f"--device {config.device}: expected auto, cpu or cuda")
