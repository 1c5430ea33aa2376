"""The tiles of HITNet as planes of disparity: their parts, and tiles of half the side."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor

TILE = 4  # side of a tile [px of its resolution]


def spread(planes: Tensor, parts: int, side: float) -> Tensor:
    """Return the disparity of each part of a tile, along its slants.

    Args:
        planes: (B, C, h, w) hypotheses.
        parts: Parts along the side of a tile.
        side: Side of a part [px].

    Returns:
        (B, 1, parts h, parts w).
    """
    offset = (torch.arange(parts, device=planes.device) - (parts - 1) / 2) * side
    across, down = offset.repeat(parts), offset.repeat_interleave(parts)
    disparity = planes[:, :1] + across[:, None, None] * planes[:, 1:2] + down[:, None, None] * planes[:, 2:3]
    return F.pixel_shuffle(disparity, parts)


def subdivided(planes: Tensor, factor: int, side: float) -> Tensor:
    """Return hypotheses (B, C, 2 h, 2 w) of half the tiles' side [px of the finer grid], disparities times a factor."""
    planes = torch.cat([planes[:, :1] * factor, planes[:, 1:]], 1)
    rest = F.interpolate(planes[:, 1:], scale_factor=2.0, mode="nearest")
    return torch.cat([spread(planes, 2, side), rest], 1)
