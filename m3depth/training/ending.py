"""When a training run ends: its budget is spent, or it has diverged and is neither continued nor saved."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from m3depth.training.config import TrainConfig
from m3depth.training.loss_config import LossConfig

LARGEST_LOSS = 1e6  # [px] by a loss weight of one; an untrained network makes less than 1e4
LARGEST_WEIGHT = 1e6  # magnitude; trained networks stay below 1e2


def shares_done(config: TrainConfig, step: int, seconds: float) -> dict[str, float]:
    """Return the spent share of each budget, by its flag and value; 1 or more is spent.

    Args:
        config: The flags of the run, with its budgets, as m3depth.training.config.in_steps returns them.
        step: Steps taken.
        seconds: Time spent [s].
    """
    shares = {}
    if config.max_steps:
        name = f"--max-steps {config.max_steps}" if config.epochs is None else f"--epochs {config.epochs}"
        shares[name] = step / config.max_steps
    if config.max_minutes:
        shares[f"--max-minutes {config.max_minutes:g}"] = seconds / 60 / config.max_minutes
    return shares


def share_done(config: TrainConfig, step: int, seconds: float) -> float:
    """Return the share of the run that is done, by the budget that ends first; 1 or more is the end.

    Args:
        config: The flags of the run, with its budgets.
        step: Steps taken.
        seconds: Time spent [s].
    """
    return max(shares_done(config, step, seconds).values())


def spent_budget(config: TrainConfig, step: int, seconds: float) -> str | None:
    """Return the budget that is spent, as its flag and value; None if none is.

    Args:
        config: The flags of the run, with its budgets.
        step: Steps taken.
        seconds: Time spent [s].
    """
    return next((name for name, share in shares_done(config, step, seconds).items() if share >= 1), None)


def loss_fault(loss: Tensor, config: LossConfig) -> str | None:
    """Return what is wrong with the loss of a step, as "loss is 3e+28"; None if it is sound.

    Args:
        loss: The loss of a step, a scalar.
        config: Weights of the loss terms, which set its size.
    """
    if not bool(torch.isfinite(loss)):
        return "loss is not finite"
    scale = max(1.0, config.disparity, config.normal, config.consistency)
    return f"loss is {float(loss):.3g}" if float(loss) > LARGEST_LOSS * scale else None


def weight_fault(network: nn.Module) -> str | None:
    """Return what is wrong with the weights of a network, as "weights are not finite"; None if they are sound."""
    largest = torch.stack([weight.detach().abs().max() for weight in network.parameters()]).max()  # NaN stays NaN
    if not bool(torch.isfinite(largest)):
        return "weights are not finite"
    return f"weights reach {float(largest):.3g}" if float(largest) > LARGEST_WEIGHT else None
