"""What HITNet returns, and its losses: of the guesses, the planes, their slants and the choices between them.

The planes are compared with the truth at every pixel, along their slants (paper, Sec. 3.4), in pixels of their own
resolution. TinyHITNet, a public training by others, takes the true slants from fitted planes; here they are the slopes
of the true disparity, where it has no edge.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor

from m3depth.network.geometry import sobel
from m3depth.rivals.output import DisparityOutput, Truth, mean_over

TILE = 4  # side of a tile [px of its resolution]
ALPHA, KNEE = 0.9, 0.1  # of the robust distance (Barron, CVPR 2019): shape, and scale [px]
FAR = 1.0  # [px] error from which the loss of a coarse disparity is constant, and its slant is not trained
SMOOTH = 1.0  # [px] difference of the true disparity to a neighbour's from which there is an edge
SURE, UNSURE = 1.0, 1.5  # [px] errors below and above which a confidence should be 1 or more, and 0 or less
MARGIN = 1.0  # by which the cost of a wrong disparity should exceed 0
GUESS_SHARE = 100.0  # weight of the guesses' loss; at 1, its gradient is a thousandth of that of the disparities
EDGE = 1.5  # [px] around the true disparity that is not wrong


class Scored(NamedTuple):
    """Hypotheses that are trained.

    Attributes:
        plane: (B, 3, h, w) disparity [px of the resolution] and its slopes.
        cell: Side of a tile [px of the image].
        scale: Pixels of the image along one of the resolution.
    """

    plane: Tensor
    cell: int
    scale: int


class Guess(NamedTuple):
    """The costs of all whole disparities at one resolution, (B, D, h, w), and pixels of the image along one of it."""

    costs: Tensor
    scale: int


class Choice(NamedTuple):
    """Confidence (B, 1, h, w) and plane (B, 3, h, w) of one of two hypotheses, with scale as in Scored."""

    confidence: Tensor
    plane: Tensor
    scale: int


@dataclass(frozen=True)
class HitNetOutput(DisparityOutput):
    """The disparity, (B, 1, H, W) [px], and what is trained beside it, on the grids of the padded images."""

    disparity: Tensor
    scored: list[Scored]
    guesses: list[Guess]
    choices: list[Choice]

    def cropped(self, height: int, width: int) -> HitNetOutput:
        """Cut the disparity to an image of height x width [px]; the truth is padded for the other maps."""
        return replace(self, disparity=self.disparity[..., :height, :width])

    def terms(self, truth: Truth) -> dict[str, Tensor]:
        """Return the sums of the four losses over all resolutions.

        Planes are compared pixel by pixel along their slants; the guesses, which have none, tile by tile.
        """
        height, width = (side * self.scored[-1].cell for side in self.scored[-1].plane.shape[-2:])
        missing = (0, width - truth.disparity.shape[-1], 0, height - truth.disparity.shape[-2])
        disparity = F.pad(
            torch.where(truth.valid, truth.disparity, -torch.ones_like(truth.disparity)), missing, value=-1
        )
        valid, slopes = disparity >= 0, sobel(disparity)
        rise, fall = (F.max_pool2d(x, 3, 1, 1) - x for x in (disparity, -disparity))  # to the pixels around
        terms: dict[str, Tensor] = {}

        def add(name: str, loss: Tensor) -> None:
            terms[name] = terms[name] + loss if name in terms else loss

        for plane, cell, scale in self.scored:
            error = (spread(plane, cell, 1 / scale) - disparity / scale).abs()
            add("disparity", mean_over(robust(error.clamp(max=FAR) if scale > 1 else error), valid))
            smooth = valid & (error.detach() < FAR) & (torch.maximum(rise, fall) < SMOOTH)
            off = (enlarged(plane[:, 1:3], cell) - slopes).abs().sum(1, keepdim=True)
            add("slant", mean_over(off, smooth))
        for costs, scale in self.guesses:
            add("guess", GUESS_SHARE * guess_loss(costs, *tile_truth(disparity, TILE * scale, scale)))
        for confidence, plane, scale in self.choices:
            error = (spread(plane.detach(), TILE * scale, 1 / scale) - disparity / scale).abs()
            sure = enlarged(confidence, TILE * scale)
            add("choice", mean_over((1 - sure).clamp(min=0), valid & (error < SURE)))
            add("choice", mean_over(sure.clamp(min=0), valid & (error > UNSURE)))
        return terms


def enlarged(maps: Tensor, cell: int) -> Tensor:
    """Return maps (B, C, h, w) of tiles at every pixel of the tiles, (B, C, cell h, cell w)."""
    return F.interpolate(maps, scale_factor=float(cell), mode="nearest")


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


def tile_truth(disparity: Tensor, cell: int, scale: int) -> tuple[Tensor, Tensor]:
    """Return the largest true disparity of each tile [px of the resolution], and whether there is one.

    Args:
        disparity: (B, 1, H, W) [px], -1 where it is unknown.
        cell: Side of a tile [px].
        scale: Pixels of the image along one of the resolution.
    """
    largest = F.max_pool2d(disparity, cell)
    return largest / scale, largest >= 0


def robust(error: Tensor) -> Tensor:
    """Return Barron's general robust distance of errors [px], which grows more slowly than the absolute error."""
    bend = abs(ALPHA - 2)
    return bend / ALPHA * (((error / KNEE).square() / bend + 1) ** (ALPHA / 2) - 1)


def guess_loss(costs: Tensor, true: Tensor, valid: Tensor) -> Tensor:
    """Return the cost at the true disparity plus the mean amount by which wrong disparities' costs are below MARGIN.

    The paper takes the least cost of a wrong disparity. With random features it is smaller than the cost at the true
    disparity, so that the loss decreases as all costs shrink: they reached 0 within fifty steps, and stayed there.

    Args:
        costs: (B, D, h, w) of the disparities 0, 1, ... D - 1.
        true: (B, 1, h, w) true disparity.
        valid: (B, 1, h, w) bool.
    """
    last = costs.shape[1] - 1
    valid = valid & (true <= last)
    place = true.clamp(0, last)
    first = place.floor().long().clamp(max=max(0, last - 1))
    part = place - first
    at_truth = (1 - part) * costs.gather(1, first) + part * costs.gather(1, (first + 1).clamp(max=last))
    steps = torch.arange(last + 1, device=costs.device)[:, None, None]
    wrong = (steps - true).abs() > EDGE
    lacks = ((MARGIN - costs).clamp(min=0) * wrong).sum(1, keepdim=True) / wrong.sum(1, keepdim=True).clamp(min=1)
    return mean_over(at_truth + lacks, valid)
