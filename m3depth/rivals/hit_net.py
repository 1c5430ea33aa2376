"""HITNet: slanted tiles of 4 x 4 pixels, initialised at five resolutions and corrected by warping the features.

Tankovich, Haene, Zhang, Kowdle, Fanello and Bouaziz: "HITNet: Hierarchical Iterative Tile Refinement Network for
Real-time Stereo Matching", CVPR 2021, arXiv:2007.12140; the published width is that of its multi-scale model.

A U-Net without normalisation describes both images at 1/16 to 1/1. At each resolution the best whole disparity of each
tile is found by comparing it with all others, and no cost volume is stored. A hypothesis is a plane with this disparity
and a descriptor. From coarse to fine, the hypotheses of the level before are enlarged along their slants and compared
with the new ones: the right features are warped by each plane, and a small network corrects and weighs both. Three
refinements end at single pixels. Each part has a loss of its own (hit_net_loss.py): the costs of the guesses, the
disparities (a robust distance, which counts an error of more than 1 px as one of 1 px at the coarser resolutions), the
slants where the disparity is right, and the confidences by which hypotheses are chosen. That of the guesses
averages over all wrong disparities, where the paper takes the most likely one, and has a larger weight than the others,
so that the features learn to match in a short training.

What takes disparities as numbers computes in full precision. The features and the guesses start with the weights of He
et al.: with PyTorch's own, which are smaller, the features fade from layer to layer, and costs in bfloat16 hardly
differ.
"""

from __future__ import annotations

from functools import partial

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from m3depth.rivals.config import HitNetConfig
from m3depth.rivals.hit_net_loss import TILE, Choice, Guess, HitNetOutput, Scored, spread
from m3depth.rivals.layers import in_float32, start_as_he
from m3depth.rivals.rival import StereoRival
from m3depth.stereo.pairs import MAX_DISPARITY

PLANE = 16  # channels of a hypothesis: disparity, its slopes across and down, and a descriptor
LEVELS = 5  # resolutions 1/1, 1/2, ... 1/16
SLOPE = 0.2  # of the leaky rectifiers


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
        # a tile of the right image at every column, and as far to the left as the search reaches
        tiles, others = (
            in_float32(partial(self._tiles, stride), maps)
            for stride, maps in ((TILE, left), (1, F.pad(right, (0, TILE - 1))))
        )
        others = F.pad(others, (self.disparities - 1, 0, 0, 0), mode="replicate")
        columns = [others[..., first::TILE].contiguous() for first in range(TILE)]
        differences = []
        for first in range(self.disparities - 1, -1, -1):
            start = first // TILE
            differences.append((tiles - columns[first % TILE][..., start : start + tiles.shape[-1]]).abs().sum(1))
        costs = torch.stack(differences, 1)
        least, disparity = costs.min(1, keepdim=True)
        source = tiles if described is None else described
        descriptor = self.descriptor(torch.cat([least.to(source.dtype), source], 1))
        flat = torch.zeros_like(least)
        return torch.cat([disparity.to(least), flat, flat, descriptor.float()], 1), costs

    def _tiles(self, stride: int, features: Tensor) -> Tensor:
        """Return descriptors (B, width, h / 4, w / stride) of the tiles at every stride-th column.

        Not in bfloat16: there, PyTorch 2.13 computes a convolution wrongly whose stride is its kernel's side.
        """
        return self.compared(F.conv2d(features, self.tile.weight, self.tile.bias, stride=(TILE, stride)))


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
        """Return the hypotheses that are taken, and confidence and plane of each set where there are two."""
        costs = self.costs(torch.cat([warped_costs(planes, left, right) for planes in sets], 1))
        change = in_float32(self.body, torch.cat([*sets, costs.float()], 1))
        planes = [old + new for old, new in zip(sets, change.split(PLANE, 1), strict=False)]
        if self.sets == 1:
            return planes[0], []
        first, second = change[:, -2:-1], change[:, -1:]
        return torch.where(first > second, planes[0], planes[1]), [
            (first, planes[0][:, :3]),
            (second, planes[1][:, :3]),
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
        return planes + in_float32(self.body, torch.cat([left.float(), planes], 1))


class HitNet(StereoRival):
    """HITNet."""

    config: HitNetConfig
    MULTIPLE = TILE * 2 ** (LEVELS - 1)

    def __init__(self, config: HitNetConfig) -> None:
        super().__init__()
        self.config = config
        widths, count = config.widths, int(MAX_DISPARITY)
        self.features = UNet(widths)
        start_as_he(self.features, SLOPE)
        self.first = nn.ModuleList()
        self.propagation = nn.ModuleList()
        for level in range(LEVELS):  # a tile's own features describe it where there are none of its size
            described = widths[level + 2] if level + 2 < LEVELS else config.compared
            self.first.append(Initialisation(widths[level], described, config.compared, count >> level))
            start_as_he(self.first[-1], SLOPE)
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
            choices += [Choice(confidence, plane, scale) for confidence, plane in pairs]
        assert planes is not None
        for number, refine in enumerate(self.refine):
            side = TILE >> number
            planes = planes if number == 0 else subdivided(planes, 1, side)
            planes = self.call(refine, planes, features[2 - number][0])
            scored.append(Scored(planes[:, :3], side, 1))
        return HitNetOutput(planes[:, :1], scored, guesses, choices)
