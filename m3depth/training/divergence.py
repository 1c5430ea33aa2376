"""What tells a training that has diverged: such a state is neither stepped on from nor saved."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from m3depth.training.loss_config import LossConfig

LARGEST_LOSS = 1e6  # [px] by a loss weight of one; an untrained network makes less than 1e4
LARGEST_WEIGHT = 1e6  # magnitude; trained networks stay below 1e2


def loss_fault(loss: Tensor, config: LossConfig) -> str | None:
    """Return what is wrong with the loss of a step, as "loss is 3e+28"; None if it is sound."""
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
