"""HITNet: slanted tiles of 4 x 4 pixels, guessed at five resolutions and corrected by what they imply.

Tankovich, Haene, Zhang, Kowdle, Fanello and Bouaziz: "HITNet: Hierarchical Iterative Tile Refinement Network for
Real-time Stereo Matching", CVPR 2021, arXiv:2007.12140; the published width is that of its multi-scale model.

A U-Net without normalisation describes both images at 1/16 to 1/1. At each resolution the best whole disparity of each
tile is found by comparing it with all others, without a volume that is kept: that is a hypothesis, a plane with a
descriptor. From coarse to fine, the hypotheses of the level before are enlarged along their slants and compared with
the new ones: the right features are warped by each plane, and a small network corrects both and says which one to take.
Three refinements end at single pixels. Each part has a loss of its own: the costs of the guesses, the disparities (a
robust distance, which counts an error of more than 1 px as one of 1 px at the coarser resolutions), the slants where
the disparity is right, and the confidences by which hypotheses are chosen. The released training takes the true slants
from fitted planes; here they are the slopes of the true disparity, where it has no edge.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from m3depth.network.geometry import sobel
from m3depth.rivals.config import HitNetConfig
from m3depth.rivals.output import Truth, mean_over
from m3depth.rivals.rival import Rival
from m3depth.stereo.pairs import MAX_DISPARITY

TILE = 4  # side of a tile [px of its resolution]
PLANE = 16  # channels of a hypothesis: disparity, its slopes across and down, and a descriptor
LEVELS = 5  # resolutions 1/1, 1/2, ... 1/16
SLOPE = 0.2  # of the leaky rectifiers
ALPHA, KNEE = 0.9, 0.1  # of the robust distance (Barron, CVPR 2019): shape, and scale [px]
FAR = 1.0  # [px] error from which a coarse disparity counts no more, and its slant is not trained
SURE, UNSURE = 1.0, 1.5  # [px] errors below and above which a confidence should be 1 or more, and 0 or less
MARGIN = 1.0  # by which the cost of a wrong disparity should exceed 0
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
    """Confidence and disparity of one of two hypotheses, (B, 1, h, w), with scale as in Scored."""

    confidence: Tensor
    disparity: Tensor
    scale: int


@dataclass(frozen=True)
class HitNetOutput:
    """The disparity, (B, 1, H, W) [px], and what is trained beside it, on the grids of the padded images."""

    disparity: Tensor
    scored: list[Scored]
    guesses: list[Guess]
    choices: list[Choice]
    normal: Tensor | None = None
    confidence: Tensor | None = None
    sky: Tensor | None = None

    def cropped(self, height: int, width: int) -> HitNetOutput:
        """Cut the disparity to an image of height x width [px]; the truth is padded for the other maps."""
        return replace(self, disparity=self.disparity[..., :height, :width])

    def terms(self, truth: Truth) -> dict[str, Tensor]:
        """Return the sums of the four losses over all resolutions."""
        height, width = (side * self.scored[-1].cell for side in self.scored[-1].plane.shape[-2:])
        missing = (0, width - truth.disparity.shape[-1], 0, height - truth.disparity.shape[-2])
        disparity = F.pad(
            torch.where(truth.valid, truth.disparity, -torch.ones_like(truth.disparity)), missing, value=-1
        )
        slopes = torch.cat([sobel(disparity), (F.max_pool2d(disparity, 3, 1, 1) - disparity).abs(),
                            (F.max_pool2d(-disparity, 3, 1, 1) + disparity).abs()], 1)  # fmt: skip
        terms: dict[str, Tensor] = {}

        def add(name: str, loss: Tensor) -> None:
            terms[name] = terms[name] + loss if name in terms else loss

        for scored in self.scored:
            true, valid, index = tile_truth(disparity, scored.cell, scored.scale)
            error = (scored.plane[:, :1] - true).abs()
            add("disparity", mean_over(robust(error.clamp(max=FAR) if scored.scale > 1 else error), valid))
            tile = slopes.flatten(2).gather(2, index.flatten(2).expand(-1, 4, -1)).unflatten(2, true.shape[-2:])
            smooth = valid & (error.detach() < FAR) & (tile[:, 2:].amax(1, keepdim=True) < 1)
            add("slant", mean_over((scored.plane[:, 1:3] - tile[:, :2]).abs().sum(1, keepdim=True), smooth))
        for costs, scale in self.guesses:
            true, valid, _ = tile_truth(disparity, TILE * scale, scale)
            add("guess", guess_loss(costs, true, valid))
        for confidence, guessed, scale in self.choices:
            true, valid, _ = tile_truth(disparity, TILE * scale, scale)
            error = (guessed.detach() - true).abs()
            add("choice", mean_over((1 - confidence).clamp(min=0), valid & (error < SURE)))
            add("choice", mean_over(confidence.clamp(min=0), valid & (error > UNSURE)))
        return terms


def tile_truth(disparity: Tensor, cell: int, scale: int) -> tuple[Tensor, Tensor, Tensor]:
    """Return the largest true disparity of each tile [px of the resolution], whether there is one, and where it is.

    Args:
        disparity: (B, 1, H, W) [px], -1 where it is unknown.
        cell: Side of a tile [px].
        scale: Pixels of the image along one of the resolution.
    """
    largest, index = F.max_pool2d(disparity, cell, return_indices=True)
    return largest / scale, largest >= 0, index


def robust(error: Tensor) -> Tensor:
    """Return Barron's general robust distance of errors [px], which grows more slowly than the absolute error."""
    bend = abs(ALPHA - 2)
    return bend / ALPHA * (((error / KNEE).square() / bend + 1) ** (ALPHA / 2) - 1)


def guess_loss(costs: Tensor, true: Tensor, valid: Tensor) -> Tensor:
    """Return the cost at the true disparity, and by how much the least cost of a wrong one falls short of MARGIN.

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
    wrong = costs.masked_fill((steps - true).abs() <= EDGE, torch.inf).amin(1, keepdim=True)
    return mean_over(at_truth + (MARGIN - wrong).clamp(min=0), valid)


def leaky(*layers: nn.Module) -> nn.Sequential:
    """Return layers with a leaky rectifier after each."""
    return nn.Sequential(*(part for layer in layers for part in (layer, nn.LeakyReLU(SLOPE))))


class UpBlock(nn.Module):
    """Features doubled in size, joined with the finer ones of the encoder."""

    def __init__(self, coarse: int, fine: int) -> None:
        super().__init__()
        self.enlarge = leaky(nn.ConvTranspose2d(coarse, fine, 2, 2))
        self.join = leaky(
            nn.Conv2d(2 * fine, fine, 1), nn.Conv2d(fine, fine, 3, padding=1), nn.Conv2d(fine, fine, 3, padding=1)
        )

    def forward(self, coarse: Tensor, fine: Tensor) -> Tensor:
        """Return (B, fine, 2 h, 2 w) from maps (B, coarse, h, w) and (B, fine, 2 h, 2 w)."""
        return self.join(torch.cat([self.enlarge(coarse), fine], 1))


class UNet(nn.Module):
    """The features: down to 1/16 and back, without normalisation."""

    def __init__(self, widths: tuple[int, ...]) -> None:
        super().__init__()
        self.down = nn.ModuleList([leaky(nn.Conv2d(3, widths[0], 3, padding=1))])
        for level in range(1, LEVELS):
            inputs, outputs = widths[level - 1 : level + 1]
            more = 3 if level == LEVELS - 1 else 1
            layers = [nn.Conv2d(outputs, outputs, 3, padding=1) for _ in range(more)]
            self.down.append(leaky(nn.Conv2d(inputs, outputs, 4, 2, padding=1), *layers))
        self.up = nn.ModuleList([UpBlock(widths[level + 1], widths[level]) for level in range(LEVELS - 1)])

    def forward(self, images: Tensor) -> list[Tensor]:
        """Return features (B, widths[n], H / 2^n, W / 2^n) for n = 0, ... 4."""
        levels: list[Tensor] = []
        for down in self.down:
            levels.append(down(levels[-1] if levels else images))
        for level in range(LEVELS - 2, -1, -1):
            levels[level] = self.up[level](levels[level + 1], levels[level])
        return levels


class Initialisation(nn.Module):
    """The hypothesis of the least cost among all whole disparities.

    Args:
        features: Channels of the features.
        described: Channels of what the descriptor is computed from, beside the cost.
        width: Channels that are compared.
        disparities: D, the number of disparities.
    """

    def __init__(self, features: int, described: int, width: int, disparities: int) -> None:
        super().__init__()
        self.disparities = disparities
        self.tile = nn.Conv2d(features, width, TILE)
        self.compared = nn.Sequential(nn.LeakyReLU(SLOPE), nn.Conv2d(width, width, 1), nn.LeakyReLU(SLOPE))
        self.descriptor = leaky(nn.Conv2d(described + 1, PLANE - 3, 1))

    def forward(self, left: Tensor, right: Tensor, described: Tensor | None) -> tuple[Tensor, Tensor]:
        """Return hypotheses (B, 16, h / 4, w / 4) and costs (B, D, h / 4, w / 4) from features (B, C, h, w).

        Args:
            left, right: The features.
            described: (B, described, h / 4, w / 4); None takes the tiles' own features.
        """
        kernel, bias = self.tile.weight, self.tile.bias
        tiles = self.compared(F.conv2d(left, kernel, bias, stride=TILE))
        # a tile of the right image at every column, and as far to the left as the search reaches
        others = self.compared(F.conv2d(F.pad(right, (0, TILE - 1)), kernel, bias, stride=(TILE, 1)))
        others = F.pad(others, (self.disparities - 1, 0, 0, 0), mode="replicate")
        columns = left.shape[-1]
        costs = torch.stack(
            [
                (tiles - others[..., first : first + columns : TILE]).abs().sum(1)
                for first in range(self.disparities - 1, -1, -1)
            ],
            1,
        ).float()
        least, disparity = costs.min(1, keepdim=True)
        source = tiles if described is None else described
        descriptor = self.descriptor(torch.cat([least.to(source.dtype), source], 1))
        flat = torch.zeros_like(least)
        return torch.cat([disparity.to(least), flat, flat, descriptor.float()], 1), costs


class ResidualPair(nn.Module):
    """Two dilated 3 x 3 convolutions beside a skip."""

    def __init__(self, width: int, dilation: int = 1) -> None:
        super().__init__()
        self.body = nn.Sequential(
            nn.Conv2d(width, width, 3, padding=dilation, dilation=dilation), nn.LeakyReLU(SLOPE),
            nn.Conv2d(width, width, 3, padding=dilation, dilation=dilation),
        )  # fmt: skip

    def forward(self, x: Tensor) -> Tensor:
        """(B, C, h, w) -> (B, C, h, w)."""
        return F.leaky_relu(x + self.body(x), SLOPE)


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


def warped_costs(planes: Tensor, left: Tensor, right: Tensor) -> Tensor:
    """Return how well the images agree on each pixel of each tile, for its plane and 1 px to either side.

    Args:
        planes: (B, C, h, w) hypotheses.
        left, right: (B, F, 4 h, 4 w) features.

    Returns:
        (B, 64, h, w): sum of the left features' magnitudes, and the three distances, of 16 pixels each.
    """
    width = left.shape[-1]
    place = torch.arange(width, device=left.device) - spread(planes, TILE, 1.0)  # (B, 1, 4 h, 4 w)
    costs = [left.abs().sum(1, keepdim=True).float()]
    for offset in (1, 0, -1):
        at = (place + offset).clamp(0, width - 1)
        # clamped as integers, so that a NaN gets an index in range too; its fraction stays NaN
        first = at.detach().floor().long().clamp(0, max(0, width - 2))
        index = first.expand(-1, right.shape[1], -1, -1)
        near, far = right.gather(3, index), right.gather(3, (index + 1).clamp(max=width - 1))
        costs.append((left - torch.lerp(near.float(), far.float(), at - first)).abs().sum(1, keepdim=True))
    return F.pixel_unshuffle(torch.cat(costs, 1), TILE)


class Propagation(nn.Module):
    """Corrects one or two sets of hypotheses by the costs of their planes, and chooses between two."""

    def __init__(self, sets: int, width: int) -> None:
        super().__init__()
        self.sets = sets
        self.costs = leaky(nn.Conv2d(64 * sets, PLANE * sets, 1))
        self.body = nn.Sequential(
            nn.Conv2d(2 * PLANE * sets, width, 3, padding=1), nn.LeakyReLU(SLOPE),
            ResidualPair(width), ResidualPair(width),
            nn.Conv2d(width, PLANE * sets + (sets if sets > 1 else 0), 3, padding=1),
        )  # fmt: skip

    def forward(self, sets: list[Tensor], left: Tensor, right: Tensor) -> tuple[Tensor, list[tuple[Tensor, Tensor]]]:
        """Return the hypotheses that are taken, and confidence and disparity of each set where there are two."""
        costs = self.costs(torch.cat([warped_costs(planes, left, right) for planes in sets], 1))
        change = self.body(torch.cat([*(x.to(costs.dtype) for x in sets), costs], 1)).float()
        planes = [old + new for old, new in zip(sets, change.split(PLANE, 1), strict=False)]
        if self.sets == 1:
            return planes[0], []
        first, second = change[:, -2:-1], change[:, -1:]
        return torch.where(first > second, planes[0], planes[1]), [
            (first, planes[0][:, :1]),
            (second, planes[1][:, :1]),
        ]


class Refine(nn.Module):
    """Corrects hypotheses by the left features on their grid."""

    def __init__(self, features: int, width: int, dilations: tuple[int, ...]) -> None:
        super().__init__()
        self.body = nn.Sequential(
            *leaky(nn.Conv2d(features + PLANE, width, 1), nn.Conv2d(width, width, 3, padding=1)),
            *(ResidualPair(width, dilation) for dilation in dilations),
            nn.Conv2d(width, PLANE, 3, padding=1),
        )

    def forward(self, planes: Tensor, left: Tensor) -> Tensor:
        """(B, 16, h, w) hypotheses and (B, F, h, w) features -> (B, 16, h, w)."""
        return planes + self.body(torch.cat([left, planes.to(left.dtype)], 1)).float()


class HitNet(Rival):
    """HITNet."""

    config: HitNetConfig
    MULTIPLE = TILE * 2 ** (LEVELS - 1)

    def __init__(self, config: HitNetConfig) -> None:
        super().__init__()
        self.config = config
        widths, count = config.widths, int(MAX_DISPARITY)
        self.features = UNet(widths)
        self.first = nn.ModuleList()
        self.propagation = nn.ModuleList()
        for level in range(LEVELS):  # a tile's own features describe it where there are none of its size
            described = widths[level + 2] if level + 2 < LEVELS else config.compared
            self.first.append(Initialisation(widths[level], described, config.compared, count >> level))
            self.propagation.append(Propagation(1 if level == LEVELS - 1 else 2, config.propagation))
        dilations = ((1, 3, 1, 1), (1, 3, 1, 1), (1, 1))
        self.refine = nn.ModuleList(
            [Refine(widths[2 - n], config.refine[n], dilations[n]) for n in range(len(config.refine))]
        )

    def estimate(self, left: Tensor, right: Tensor, camera: Tensor) -> HitNetOutput:
        """Return the disparity of each pixel, with all that is trained."""
        features = [x.chunk(2) for x in self.call(self.features, torch.cat([left, right]))]
        scored, guesses, choices = [], [], []
        planes: Tensor | None = None
        for level in range(LEVELS - 1, -1, -1):
            of_left, of_right = features[level]
            described = features[level + 2][0] if level + 2 < LEVELS else None
            new, costs = self.call(self.first[level], of_left, of_right, described)
            sets = [new] if planes is None else [new, subdivided(planes, 2, TILE)]
            planes, pairs = self.call(self.propagation[level], sets, of_left, of_right)
            scale = 2**level
            scored.append(Scored(planes[:, :3], TILE * scale, scale))
            guesses.append(Guess(costs, scale))
            choices += [Choice(confidence, disparity, scale) for confidence, disparity in pairs]
        assert planes is not None
        for number, refine in enumerate(self.refine):
            side = TILE >> number
            planes = planes if number == 0 else subdivided(planes, 1, side)
            planes = self.call(refine, planes, features[2 - number][0])
            scored.append(Scored(planes[:, :3], side, 1))
        return HitNetOutput(planes[:, :1], scored, guesses, choices)
