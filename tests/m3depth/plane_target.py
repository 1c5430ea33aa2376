"""Ground truth of a plane before a camera, with and without gaps."""

import torch

from m3depth.network.geometry import pixel_rays
from m3depth.training.batch import Target

CAMERA = torch.tensor([[60.0, 55.0, 9.3, 5.1]], dtype=torch.float64)


def plane(normal: tuple[float, float, float], height: int = 16, width: int = 24) -> tuple[torch.Tensor, torch.Tensor]:
    n = torch.tensor(normal, dtype=torch.float64)
    n = (n / n.norm())[None, :, None, None].expand(1, 3, height, width)
    depth = -1.2 / (pixel_rays(CAMERA, height, width) * n).sum(1, keepdim=True)
    return 16.2 / depth, n


def make_target(height: int = 16, width: int = 24) -> Target:
    disparity, normal = plane((0.0, -0.5, -1.0), height, width)
    yes = torch.ones_like(disparity, dtype=torch.bool)
    return Target(disparity.float(), normal.float(), yes, ~yes, ~yes, ~yes, ~yes, CAMERA.float(), torch.tensor([0.27]))


def random_holes(shape: tuple[int, ...]) -> torch.Tensor:
    return torch.rand(shape, generator=torch.Generator().manual_seed(0)) < 0.7


def every_second_row(shape: tuple[int, ...]) -> torch.Tensor:
    return (torch.arange(shape[2]) % 2 == 0)[:, None].expand(shape)


def with_holes(target: Target, holes: torch.Tensor) -> Target:
    """As pack and to_batch make it of depth that is NaN there."""
    return target._replace(disparity=target.disparity.masked_fill(holes, 0), label=target.label & ~holes)
