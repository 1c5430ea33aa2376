"""LightStereo: matching scores at 1/4, aggregated by cheap 2-D convolutions. A modern method for computers without
a GPU.

Guo, Zhang, Zhang, Zheng, Nie, Poggi and Chen: "LightStereo: Channel Boost Is All You Need for Efficient 2D Cost
Aggregation", ICRA 2025, arXiv:2406.19833; the published width is LightStereo-S.

A MobileNetV2 (Sandler et al., CVPR 2018; here without the weights of ImageNet, since none of the methods starts from
other data) and a decoder describe both images. Their correlation for 48 shifts at 1/4 is an image of 48 channels, which
an hourglass of inverted residual blocks aggregates: these widen the channels, which hold the distribution of the
scores. Strips of up to 21 pixels over the left features weigh the volume at each scale. Soft argmin gives the
disparity, and weights from the left image upsample it: each pixel is a mean over 3 x 3 cells.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from m3depth.network.backbone import group_norm
from m3depth.network.cost_volume import group_correlation_volume, soft_argmin
from m3depth.rivals.config import LightStereoConfig
from m3depth.rivals.output import SequenceOutput
from m3depth.rivals.rival import StereoRival

CELL = 4  # side of a cell of the volume [px]
STRIPS = (7, 11, 21)  # lengths of the attention's kernels
COARSE_SHARE = 0.3  # weight of the loss of the map at 1/4
# MobileNetV2's stages: expansion, place of the width in config.widths, number of blocks, stride of the first.
STAGES = ((1, 1, 1, 1), (6, 2, 2, 2), (6, 3, 3, 2), (6, 4, 4, 2), (6, 5, 3, 1), (6, 6, 3, 2))


def whole_norm(channels: int) -> nn.GroupNorm:
    """Return a group normalisation with all channels in one group."""
    return nn.GroupNorm(1, channels)


class InvertedResidual(nn.Module):
    """1 x 1 to more channels, 3 x 3 in each, 1 x 1 to fewer; with a skip where the shape stays (MobileNetV2).

    Args:
        inputs: Channels of the input.
        outputs: Channels of the output.
        stride: Stride.
        expansion: Factor of the channels inside; 1 leaves out the first layer.
        norm: Returns the normalisation of a number of channels.
    """

    def __init__(
        self, inputs: int, outputs: int, stride: int, expansion: int, norm: Callable[[int], nn.Module] = group_norm
    ) -> None:
        super().__init__()
        inner = inputs * expansion
        widen = [nn.Conv2d(inputs, inner, 1, bias=False), norm(inner), nn.ReLU6(inplace=True)]
        self.layers = nn.Sequential(
            *(widen if expansion > 1 else []),
            nn.Conv2d(inner, inner, 3, stride, padding=1, groups=inner, bias=False),
            norm(inner),
            nn.ReLU6(inplace=True),
            nn.Conv2d(inner, outputs, 1, bias=False),
            norm(outputs),
        )
        self.skips = stride == 1 and inputs == outputs

    def forward(self, x: Tensor) -> Tensor:
        """(B, inputs, H, W) -> (B, outputs, H / stride, W / stride)."""
        return x + self.layers(x) if self.skips else self.layers(x)


class Join(nn.Module):
    """Coarse features, doubled in size, joined with finer ones."""

    def __init__(self, coarse: int, fine: int) -> None:
        super().__init__()
        self.enlarge = nn.Sequential(
            nn.ConvTranspose2d(coarse, fine, 4, 2, padding=1, bias=False), group_norm(fine), nn.LeakyReLU(0.2)
        )
        self.join = nn.Sequential(
            nn.Conv2d(2 * fine, fine, 3, padding=1, bias=False), group_norm(fine), nn.LeakyReLU(0.2)
        )

    def forward(self, coarse: Tensor, fine: Tensor) -> Tensor:
        """Return (B, fine, 2 h, 2 w) from maps (B, coarse, h, w) and (B, fine, 2 h, 2 w)."""
        return self.join(torch.cat([fine, self.enlarge(coarse)], 1))


class MobileFeatures(nn.Module):
    """MobileNetV2 down to 1/32, and a decoder up to 1/4.

    Args:
        widths: Channels of the first convolution and of the six stages of which the features at 1/4, 1/8, 1/16 and
            1/32 are the outputs of the 2nd, 3rd, 5th and 6th.
    """

    def __init__(self, widths: tuple[int, ...]) -> None:
        super().__init__()
        self.first = nn.Sequential(
            nn.Conv2d(3, widths[0], 3, 2, padding=1, bias=False), group_norm(widths[0]), nn.ReLU6(inplace=True)
        )
        self.stages = nn.ModuleList()
        inputs = widths[0]
        for expansion, place, count, stride in STAGES:
            blocks = []
            for number in range(count):
                blocks.append(InvertedResidual(inputs, widths[place], stride if number == 0 else 1, expansion))
                inputs = widths[place]
            self.stages.append(nn.Sequential(*blocks))
        self.channels = (widths[2], widths[3], widths[5], widths[6])
        self.joins = nn.ModuleList([Join(coarse, fine) for fine, coarse in pairwise(self.channels)])
        self.last = nn.Sequential(
            nn.Conv2d(widths[2], widths[2], 3, padding=1, padding_mode="replicate", bias=False),
            nn.InstanceNorm2d(widths[2]),
        )

    def forward(self, images: Tensor) -> list[Tensor]:
        """Return features (B, C, H / 4, W / 4), / 8, / 16 and / 32."""
        x, levels = self.first(images), []
        for number, stage in enumerate(self.stages):
            x = stage(x)
            if number in (1, 2, 4, 5):
                levels.append(x)
        for place in (2, 1, 0):
            levels[place] = self.joins[place](levels[place + 1], levels[place])
        return [self.last(levels[0]), *levels[1:]]


class StripAttention(nn.Module):
    """Weights of a volume from the left features, by pairs of long, thin kernels (multi-scale convolutional attention).

    Args:
        channels: Channels of the volume.
        features: Channels of the features.
    """

    def __init__(self, channels: int, features: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(features, channels, 1)
        self.strips = nn.ModuleList(
            [
                nn.Sequential(
                    nn.Conv2d(channels, channels, (1, length), padding=(0, length // 2), groups=channels),
                    nn.Conv2d(channels, channels, (length, 1), padding=(length // 2, 0), groups=channels),
                )
                for length in STRIPS
            ]
        )
        self.last = nn.Conv2d(channels, channels, 1)

    def forward(self, volume: Tensor, features: Tensor) -> Tensor:
        """Return the volume (B, channels, H, W), weighed by features (B, features, H, W)."""
        x = self.first(features)
        return self.last(x + sum(strip(x) for strip in self.strips)) * volume


class Hourglass(nn.Module):
    """The aggregation: inverted residual blocks at 1/4, 1/8 and 1/16, and back.

    Its channels are shifts, and one group of the normalisation has them all. Small groups would amplify the scores of
    shifts without a match.

    Args:
        shifts: Channels of the volume at 1/4, one a shift; twice and four times as many at 1/8 and 1/16.
        blocks: Number of blocks at each scale.
        expansion: Factor of the channels inside a block.
        features: Channels of the left features at these scales.
    """

    def __init__(self, shifts: int, blocks: tuple[int, int, int], expansion: int, features: tuple[int, ...]) -> None:
        super().__init__()
        widths = (shifts, 2 * shifts, 4 * shifts)
        self.down = nn.ModuleList()
        inputs = shifts
        for scale, (width, count) in enumerate(zip(widths, blocks, strict=True)):
            rows = [InvertedResidual(
                inputs if n == 0 else width, width, 2 if scale and n == 0 else 1, expansion, whole_norm
            ) for n in range(count)]  # fmt: skip
            self.down.append(nn.Sequential(*rows))
            inputs = width
        self.attention = nn.ModuleList([StripAttention(w, f) for w, f in zip(widths, features[:3], strict=True)])
        self.skips = nn.ModuleList([InvertedResidual(w, w, 1, expansion, whole_norm) for w in widths[:2]])
        self.up = nn.ModuleList(
            [
                nn.Sequential(
                    nn.ConvTranspose2d(coarse, fine, 3, 2, padding=1, output_padding=1, bias=False), whole_norm(fine)
                )
                for fine, coarse in pairwise(widths)
            ]
        )

    def forward(self, volume: Tensor, features: list[Tensor]) -> Tensor:
        """Return the aggregated scores (B, shifts, H / 4, W / 4), larger is better."""
        levels = []
        for down, attention, image in zip(self.down, self.attention, features, strict=False):
            volume = attention(down(volume), image)
            levels.append(volume)
        x = levels[2]
        for scale in (1, 0):
            x = F.relu(self.up[scale](x) + self.skips[scale](levels[scale]))
        return x


class LightStereo(StereoRival):
    """LightStereo."""

    config: LightStereoConfig

    def __init__(self, config: LightStereoConfig) -> None:
        super().__init__()
        self.config = config
        quarter, guide, half = config.widths[2], config.guide, config.half
        self.features = MobileFeatures(config.widths)
        self.aggregation = Hourglass(config.shifts, config.blocks, config.expansion, self.features.channels)
        self.guide = nn.Sequential(
            nn.Conv2d(quarter, guide, 3, padding=1, bias=False), nn.InstanceNorm2d(guide), nn.LeakyReLU(),
            nn.Conv2d(guide, guide, 3, padding=1, bias=False), nn.InstanceNorm2d(guide), nn.ReLU(),
        )  # fmt: skip
        self.image = nn.Sequential(
            nn.Conv2d(3, half, 3, 2, padding=1, bias=False), group_norm(half), nn.LeakyReLU(),
            nn.Conv2d(half, half, 3, padding=1, bias=False), group_norm(half), nn.ReLU(),
        )  # fmt: skip
        self.join = Join(guide, half)
        self.shares = nn.ConvTranspose2d(half, 9, 4, 2, padding=1, bias=False)

    @property
    def reach(self) -> float:
        """The disparity at which the shifts end [px]."""
        return float(CELL * self.config.shifts)

    def estimate(self, left: Tensor, right: Tensor, camera: Tensor) -> SequenceOutput:
        """Return the disparity and, in training, that of 1/4 enlarged without weights before it."""
        features = self.call(self.features, torch.cat([left, right]))
        match_left, match_right = features[0].float().chunk(2)  # (B, C, H / 4, W / 4)
        volume = group_correlation_volume(match_left, match_right, self.config.shifts, 1)[:, 0]
        of_left = [x[: len(left)] for x in features]
        scores = self.call(self.aggregation, volume.to(of_left[0].dtype), of_left).float()
        cells = soft_argmin(scores, float(CELL))  # (B, 1, H / 4, W / 4) [px]
        weights = self.shares(self.join(self.guide(of_left[0]), self.image(left)))  # (B, 9, H, W)
        full = by_neighbours(cells, weights.float().softmax(1))
        if not self.training:
            return SequenceOutput([full], [1.0])
        coarse = F.interpolate(cells, left.shape[-2:], mode="bilinear")
        return SequenceOutput([coarse, full], [COARSE_SHARE, 1.0], knee=1.0)


def by_neighbours(cells: Tensor, shares: Tensor) -> Tensor:
    """Return a full map (B, 1, H, W), each pixel the mean of the 3 x 3 cells around its own.

    Args:
        cells: (B, 1, h, w).
        shares: (B, 9, H, W) weights, whose sum is 1.
    """
    height, width = cells.shape[-2:]
    padded = F.pad(cells, (1, 1, 1, 1), mode="replicate")
    around = [padded[..., i : i + height, j : j + width] for i in range(3) for j in range(3)]
    return (F.interpolate(torch.cat(around, 1), shares.shape[-2:], mode="nearest") * shares).sum(1, keepdim=True)
