"""A batch of random images with a plain ground truth, and the training loss of a network on it."""

from collections.abc import Callable

import pytest
import torch

from m3depth.network.model import M3Depth
from m3depth.training.batch import Target
from m3depth.training.loss_config import LossConfig
from m3depth.training.losses import total_loss

Loss = Callable[..., torch.Tensor]


def loss_of(model: M3Depth, size: int = 64, batch: int = 1) -> torch.Tensor:
    rng = torch.Generator().manual_seed(1)
    left, right = torch.rand(2, batch, 3, size, size, generator=rng)
    camera = torch.tensor([[60.0, 60, size / 2, size / 2]] * batch)
    disparity = torch.full((batch, 1, size, size), 24.0)
    normal = torch.tensor([0.0, -0.6, -0.8])[None, :, None, None].expand(batch, 3, size, size)
    yes = torch.ones_like(disparity, dtype=torch.bool)
    device = next(model.parameters()).device
    truth = disparity, normal, yes, ~yes, ~yes, ~yes, ~yes, camera, torch.full((batch,), 0.27)
    target = Target(*(x.to(device) for x in truth))
    return total_loss(model(left.to(device), right.to(device), target.camera), target, LossConfig())[0]


@pytest.fixture(scope="session")
def training_loss() -> Loss:
    """training_loss(model, size=64, batch=1): the loss of a fixed random batch, to be minimised."""
    return loss_of
