"""The feature extractor that both eyes share (paper, Table I)."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn

from m3depth.network.wavelet import WaveletConv

LEAST_CONTRAST = 0.01  # standard deviation that a pair is divided by at least


def normalised(left: Tensor, right: Tensor) -> Tensor:
    """Give the images of a pair one mean and one contrast, which keeps the gain between the two.

    Args:
        left, right: (B, 3, H, W).

    Returns:
        (2 B, 3, H, W), left images first.
    """
    mean = left.mean((1, 2, 3), keepdim=True)
    scale = left.std((1, 2, 3), keepdim=True).clamp(min=LEAST_CONTRAST)
    pair = (torch.cat([left, right]) - torch.cat([mean, mean])) / torch.cat([scale, scale])
    return pair.contiguous(memory_format=torch.channels_last)


class Features(NamedTuple):
    """Features of B pairs at three scales, those of the left images first.

    Attributes:
        half: (2 B, C2, H / 2, W / 2).
        quarter: (2 B, C4, H / 4, W / 4).
        eighth: (2 B, C8, H / 8, W / 8), or those of the left images alone, (B, C8, H / 8, W / 8).
    """

    half: Tensor
    quarter: Tensor
    eighth: Tensor


def group_norm(channels: int) -> nn.GroupNorm:
    """Return a group normalisation with 8 channels a group, or one group if 8 does not divide them.

    There is no batch normalisation: batch statistics degrade the refinement.
    """
    groups = channels // 8 if channels % 8 == 0 else 1
    return nn.GroupNorm(groups, channels)


def conv_block(inputs: int, outputs: int, kernel: int = 3, stride: int = 1, dilation: int = 1) -> nn.Sequential:
    """Return convolution, group normalisation and ReLU. The output has the input's size over the stride.

    Args:
        inputs: Channels of the input.
        outputs: Channels of the output.
        kernel: Side of the kernel, odd.
        stride: Stride of the convolution.
        dilation: Dilation of the kernel.
    """
    padding = dilation * (kernel // 2)
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, kernel, stride, padding, dilation, bias=False),
        group_norm(outputs),
        nn.ReLU(inplace=True),
    )


class WaveletBlock(nn.Module):
    """A convolution at one scale: the wavelet convolution or, with levels = 0, a plain one; normalised, then ReLU.

    Args:
        channels: Channels of input and output.
        levels: Wavelet levels; 0 for a plain 3 x 3 convolution.
        kernel: Side of the wavelet convolution's kernels, odd.
        skips: True makes it a residual block, x + conv(x + wavelet(x)), whose second convolution is 3 x 3. False leaves
            the one convolution of the paper's table.
    """

    def __init__(self, channels: int, levels: int, kernel: int, skips: bool) -> None:
        super().__init__()
        first = WaveletConv(channels, levels, kernel) if levels else nn.Conv2d(channels, channels, 3, padding=1)
        self.first = nn.Sequential(first, group_norm(channels), nn.ReLU(inplace=True))
        self.second = conv_block(channels, channels) if skips else None

    def forward(self, x: Tensor) -> Tensor:
        """(B, C, H, W) -> (B, C, H, W)."""
        if self.second is None:
            return self.first(x)
        return x + self.second(x + self.first(x))


class Backbone(nn.Module):
    """The feature extractor: a 7 x 7 and five 3 x 3 convolutions down to 1/8 (paper, Table I).

    Conv4 and Conv6 are wavelet convolutions.

    Args:
        channels: Widths at 1/2, 1/4 and 1/8.
        levels: Wavelet levels at 1/4 and at 1/8; 0 for none.
        kernel: Side of the wavelet convolutions' kernels, odd.
        skips: See WaveletBlock.
    """

    def __init__(
        self, channels: tuple[int, int, int], levels: tuple[int, int], kernel: int, skips: bool = True
    ) -> None:
        super().__init__()
        half, quarter, eighth = channels
        self.stem = nn.Sequential(conv_block(3, half, kernel=7, stride=2), conv_block(half, half))
        self.quarter = nn.Sequential(
            conv_block(half, quarter, stride=2), WaveletBlock(quarter, levels[0], kernel, skips)
        )
        self.eighth = nn.Sequential(
            conv_block(quarter, eighth, stride=2), WaveletBlock(eighth, levels[1], kernel, skips)
        )

    def forward(self, pair: Tensor, both_eighths: bool = True) -> Features:
        """Return the features of normalised images.

        Args:
            pair: (2 B, 3, H, W), left images first.
            both_eighths: Whether the right images' features at 1/8 are computed: the cost volume alone needs them.
        """
        half = self.stem(pair)  # (2 B, C2, H / 2, W / 2)
        quarter = self.quarter(half)  # (2 B, C4, H / 4, W / 4)
        return Features(half, quarter, self.eighth(quarter if both_eighths else quarter.chunk(2)[0]))
