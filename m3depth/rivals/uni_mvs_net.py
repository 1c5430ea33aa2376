"""UniMVSNet for a pair: a cascade of three plane sweeps, whose scores are class and offset of a plane at once.

Peng, Wang, Wang, Lai and Wang: "Rethinking Depth Estimation for Multi-View Stereo: A Unified Representation", CVPR
2022, arXiv:2201.01501; the sizes are those of its released training on DTU.

A feature pyramid describes both images at three resolutions. At the coarsest one, the right features are moved by
planes that cover the whole search; at the finer ones by fewer, closer planes around the result before. The squared
differences, weighed by a small network, form a volume, which a 3-D U-Net aggregates. The unified representation: each
plane has a value, trained to be 0, but for the last plane below the truth, where it is 1 at the plane and falls to 0 at
the next one. The plane with the largest value and that value give the result, so that it is both a classification and a
regression. The unified focal loss gives hard planes more weight.

The method is for many views and planes of depth. Here there is one more view, which is rectified, and the planes are
those of disparity: their steps cover the image evenly, and the horizon is within the search. The planes of the finer
two sweeps are 2 and 1 px apart and begin at 0 at least, where the released code divides the interval of the sweep
before, and does not limit it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from m3depth.network.backbone import conv_block, group_norm
from m3depth.rivals.config import UniMvsNetConfig
from m3depth.rivals.layers import sampled, upsampled
from m3depth.rivals.output import DisparityOutput, Truth
from m3depth.rivals.rival import StereoRival
from m3depth.stereo.pairs import MAX_DISPARITY

STAGES = 3
SHARES = (0.5, 1.0, 2.0)  # weights of the stages' losses
FOCUS = (2, 1, 0)  # exponents of the focal weights, by stage
EMPTY = (0.75, 0.5, 0.25)  # weights of planes whose value should be 0, by stage
BASE = math.log(5)  # the focal weights are sigmoids of this base


class Sweep(NamedTuple):
    """The planes of one stage, and what the network says of them.

    Attributes:
        scores: (B, D, h, w) values before the sigmoid.
        start: (B, 1, h, w) disparity of the first plane [px].
        step: Disparity between two planes [px].
        cell: Side of a cell [px]; cell k lies at pixel k times this.
    """

    scores: Tensor
    start: Tensor
    step: float
    cell: int

    def disparity(self) -> Tensor:
        """Return the result (B, 1, h, w) [px]: the plane of the largest value, and how far the truth is above it."""
        value, plane = self.scores.max(1, keepdim=True)
        return self.start + (plane + 1 - value.sigmoid()) * self.step

    def cropped(self, height: int, width: int) -> Sweep:
        """Cut the maps to an image of height x width [px]."""
        rows, columns = (-(-side // self.cell) for side in (height, width))
        return self._replace(scores=self.scores[..., :rows, :columns], start=self.start[..., :rows, :columns])


@dataclass(frozen=True)
class UnifiedOutput(DisparityOutput):
    """The disparity, (B, 1, H, W) [px], and the sweeps that are trained, from coarse to fine."""

    disparity: Tensor
    sweeps: tuple[Sweep, ...]

    def cropped(self, height: int, width: int) -> UnifiedOutput:
        """Cut the maps to an image of height x width [px]."""
        sweeps = tuple(sweep.cropped(height, width) for sweep in self.sweeps)
        return replace(self, disparity=self.disparity[..., :height, :width], sweeps=sweeps)

    def terms(self, truth: Truth) -> dict[str, Tensor]:
        """Return the loss of each stage."""
        return {
            f"stage_{number + 1}": SHARES[number] * focal_loss(sweep, truth, FOCUS[number], EMPTY[number])
            for number, sweep in enumerate(self.sweeps)
        }


def focal_loss(sweep: Sweep, truth: Truth, focus: int, empty: float) -> Tensor:
    """Return the unified focal loss of a stage, the mean over all planes of the valid pixels (Sec. 3.4).

    Args:
        sweep: The planes, and their scores.
        truth: At the images' size.
        focus: Exponent of the focal weights.
        empty: Weight of planes whose value should be 0.
    """
    cell = slice(None, None, sweep.cell)
    valid = truth.valid[..., cell, cell]
    place = (truth.disparity[..., cell, cell] - sweep.start) / sweep.step
    count = sweep.scores.shape[1]
    above = place - torch.arange(count, device=place.device)[:, None, None]  # (B, D, h, w), in steps
    positive = (above >= 0) & (above < 1)
    value = torch.where(positive, 1 - above, torch.zeros_like(above))
    largest = torch.where(positive.any(1, keepdim=True), value.amax(1, keepdim=True), torch.ones_like(place))
    scores = sweep.scores.float()
    values = scores.sigmoid()
    hard = 1 + 4 * (torch.sigmoid(BASE * (value - values).abs() / largest) - 0.5)  # 1 to 3
    easy = 2 * (torch.sigmoid(BASE * values / largest) - 0.5)  # 0 to 1
    weight = torch.where(positive, hard**focus, empty * easy**focus)
    loss = F.binary_cross_entropy_with_logits(scores, value, reduction="none") * weight
    return torch.where(valid, loss, torch.zeros_like(loss)).sum() / (count * valid.sum()).clamp(min=1)


def block(inputs: int, outputs: int, stride: int = 1) -> nn.Sequential:
    """Return a 3 x 3 x 3 convolution, group normalisation and ReLU."""
    return nn.Sequential(
        nn.Conv3d(inputs, outputs, 3, stride, padding=1, bias=False), group_norm(outputs), nn.ReLU(inplace=True)
    )


def doubling(inputs: int, outputs: int) -> nn.Sequential:
    """Return a transposed 3 x 3 x 3 convolution that doubles all sides, group normalisation and ReLU."""
    layer = nn.ConvTranspose3d(inputs, outputs, 3, 2, padding=1, output_padding=1, bias=False)
    return nn.Sequential(layer, group_norm(outputs), nn.ReLU(inplace=True))


class FeaturePyramid(nn.Module):
    """Features at three resolutions: three groups of convolutions down, and sums with what is coarser on the way up.

    Args:
        width: Channels at the finest resolution; twice and four times as many at the others.
        finest: Pixels of the image along a cell of the finest.
    """

    def __init__(self, width: int, finest: int) -> None:
        super().__init__()
        coarse = 4 * width
        self.down = nn.ModuleList([nn.Sequential(conv_block(3, width, stride=finest), conv_block(width, width))])
        for inputs in (width, 2 * width):
            outputs = 2 * inputs
            self.down.append(
                nn.Sequential(
                    conv_block(inputs, outputs, 5, 2), conv_block(outputs, outputs), conv_block(outputs, outputs)
                )
            )
        self.beside = nn.ModuleList([nn.Conv2d(channels, coarse, 1) for channels in (2 * width, width)])
        self.last = nn.ModuleList(
            [
                nn.Conv2d(coarse, coarse, 1, bias=False),
                nn.Conv2d(coarse, 2 * width, 3, padding=1, bias=False),
                nn.Conv2d(coarse, width, 3, padding=1, bias=False),
            ]
        )

    def forward(self, images: Tensor) -> list[Tensor]:
        """Return features (B, 4 width, h / 4, w / 4), (B, 2 width, h / 2, w / 2) and (B, width, h, w)."""
        levels = []
        for down in self.down:
            images = down(images)
            levels.append(images)
        x = levels[-1]
        features = [self.last[0](x)]
        for beside, last, finer in zip(self.beside, self.last[1:], levels[-2::-1], strict=True):
            x = F.interpolate(x, scale_factor=2.0, mode="nearest") + beside(finer)
            features.append(last(x))
        return features


class Aggregation(nn.Module):
    """The weights of the differences, and the 3-D U-Net that gives each plane a score.

    Args:
        features: Channels of the features.
        width: Channels at full size.
    """

    def __init__(self, features: int, width: int) -> None:
        super().__init__()
        self.weight = nn.Sequential(
            nn.Conv3d(features, 1, 1, bias=False), group_norm(1), nn.ReLU(inplace=True),
            nn.Conv3d(1, 1, 1, bias=False), group_norm(1), nn.ReLU(inplace=True),
        )  # fmt: skip
        self.first = block(features, width)
        widths = [width << level for level in range(4)]
        self.down = nn.ModuleList(
            [nn.Sequential(block(w, 2 * w, 2), block(2 * w, 2 * w)) for w in widths[:3]]
        )  # fmt: skip
        self.up = nn.ModuleList([doubling(2 * w, w) for w in widths[2::-1]])
        self.last = nn.Conv3d(width, 1, 3, padding=1, bias=False)

    def forward(self, left: Tensor, moved: Tensor) -> Tensor:
        """Return the scores (B, D, h, w).

        Args:
            left: (B, features, h, w).
            moved: (B, features, D, h, w), the right features moved by each plane.
        """
        volume = (left[:, :, None] - moved).square()
        x = self.first((self.weight(volume) + 1) * volume)
        levels = [x]
        for down in self.down:
            x = down(x)
            levels.append(x)
        for up, beside in zip(self.up, levels[2::-1], strict=True):
            x = beside + up(x)
        return self.last(x)[:, 0]


def moved_features(right: Tensor, start: Tensor, step: float, count: int, cell: int) -> Tensor:
    """Return the right features that lie at each plane, (B, C, D, h, w), 0 outside.

    Args:
        right: (B, C, h, w).
        start: (B, 1, h, w) disparity of the first plane [px].
        step: Disparity between two planes [px].
        count: D, the number of planes.
        cell: Side of a cell [px].
    """
    height, width = right.shape[-2:]
    planes = (start + step * torch.arange(count, device=start.device)[:, None, None]) / cell  # (B, D, h, w)
    columns = torch.arange(width, device=start.device) - planes
    rows = torch.arange(height, device=start.device, dtype=columns.dtype)[:, None].expand_as(columns)
    place = torch.stack([columns, rows], 1).flatten(2, 3)  # (B, 2, D h, w)
    return sampled(right, place).unflatten(2, (count, height))


class UniMvsNet(StereoRival):
    """UniMVSNet."""

    config: UniMvsNetConfig
    MULTIPLE = 64  # two resolutions of the features and three of the aggregation, at half of the image's size

    def __init__(self, config: UniMvsNetConfig) -> None:
        super().__init__()
        self.config = config
        self.features = FeaturePyramid(config.width, config.finest)
        self.aggregation = nn.ModuleList(
            [Aggregation(config.width << (STAGES - 1 - stage), config.volume) for stage in range(STAGES)]
        )

    def estimate(self, left: Tensor, right: Tensor, camera: Tensor) -> UnifiedOutput:
        """Return the disparity of the last stage, with the sweeps of all."""
        config = self.config
        levels = [x.chunk(2) for x in self.call(self.features, torch.cat([left, right]))]
        sweeps: list[Sweep] = []
        step = MAX_DISPARITY / config.planes[0]
        for stage, (of_left, of_right) in enumerate(levels):
            count, cell = config.planes[stage], config.finest << (STAGES - 1 - stage)
            if stage == 0:
                start = torch.zeros_like(of_left[:, :1], dtype=torch.float32)
            else:
                step /= 2
                start = (upsampled(sweeps[-1].disparity().detach(), 2) - count / 2 * step).clamp(min=0)
            scores = self.call(self._scores, stage, of_left, of_right, start, step, cell)
            sweeps.append(Sweep(scores.float(), start, step, cell))
        disparity = sweeps[-1].disparity()
        return UnifiedOutput(disparity if config.finest == 1 else upsampled(disparity, 2), tuple(sweeps))

    def _scores(self, stage: int, left: Tensor, right: Tensor, start: Tensor, step: float, cell: int) -> Tensor:
        """Return the scores of the planes of a stage, whose features are made and used once."""
        moved = moved_features(right.float(), start, step, self.config.planes[stage], cell)
        # In bfloat16 on a CPU, PyTorch 2.13 gives some weights of small 3-D convolutions gradients of 1e35.
        inexact = torch.is_autocast_enabled("cpu") and not torch.is_grad_enabled()
        with torch.autocast("cpu", enabled=inexact):
            return self.aggregation[stage](left.float(), moved)
