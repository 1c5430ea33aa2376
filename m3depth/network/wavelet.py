"""Haar wavelets and the wavelet-enhanced convolution (paper, Algorithm 1)."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

# f_A, f_H, f_V, f_D of the paper. PyWavelets calls f_H its cV and f_V its cH; f_A and f_D are its cA and cD.
HAAR = 0.5 * torch.tensor([[[1.0, 1], [1, 1]], [[1, -1], [1, -1]], [[1, 1], [-1, -1]], [[1, -1], [-1, 1]]])


def haar_filters(channels: int) -> Tensor:
    """Return the four Haar filters (paper, Eq. 2), repeated for every channel: (4 C, 1, 2, 2)."""
    return HAAR[:, None].repeat(channels, 1, 1, 1)


def haar_transform(x: Tensor, filters: Tensor | None = None) -> Tensor:
    """Compute one level of the 2-D Haar transform, as a depth-wise convolution of stride 2.

    Args:
        x: (B, C, H, W), H and W even.
        filters: haar_filters(C), if the caller keeps them.

    Returns:
        (B, 4 C, H / 2, W / 2); channel 4 c + s is sub-band s of channel c, in the order A, H, V, D.

    Raises:
        ValueError: H or W is odd.
    """
    if x.shape[-2] % 2 or x.shape[-1] % 2:
        raise ValueError(f"the Haar transform needs even sizes, got {x.shape[-2]} x {x.shape[-1]}")
    filters = haar_filters(x.shape[1]) if filters is None else filters
    return F.conv2d(x, filters.to(x), stride=2, groups=len(filters) // 4)


def inverse_haar_transform(average: Tensor, across: Tensor, down: Tensor, diagonal: Tensor) -> Tensor:
    """Return the image (B, C, 2 H, 2 W) of the four sub-bands A, H, V and D, (B, C, H, W) each (paper, Eq. 3).

    The filters are orthonormal, so this is the transposed convolution with them. Sums and a shuffle of pixels take a
    third of its time in bf16.
    """
    left_and_right = average + across, average - across
    upper_and_lower = down + diagonal, down - diagonal
    pixels = [x + y for x, y in zip(left_and_right, upper_and_lower)]
    pixels += [x - y for x, y in zip(left_and_right, upper_and_lower)]
    return F.pixel_shuffle(0.5 * torch.stack(pixels, 2).flatten(1, 2), 2)


class WaveletConv(nn.Module):
    """Wavelet-enhanced convolution: a small depth-wise kernel at every level of a Haar decomposition.

    Z_i = IWT(beta_i (Y_A,i + Z_i+1), Y_HF,i) from the deepest level up, and Z_0 = Y_A,0 + Z_1 (paper, Eq. 5-7). The
    paper leaves beta's shape and initial value open: here it is one learnable number for each channel and level, and
    starts at 1. Depth-wise kernels mix no channels, so a 1 x 1 convolution follows. H and W must be multiples of 2 **
    levels.

    Args:
        channels: Channels of input and output.
        levels: Levels of the decomposition, 1 or more.
        kernel: Side of the depth-wise kernels, odd.
    """

    def __init__(self, channels: int, levels: int, kernel: int) -> None:
        super().__init__()
        self.levels = levels
        pad = kernel // 2
        self.base = nn.Conv2d(channels, channels, kernel, padding=pad, groups=channels)
        self.bands = nn.ModuleList(
            nn.Conv2d(4 * channels, 4 * channels, kernel, padding=pad, groups=4 * channels, bias=False)
            for _ in range(levels)
        )
        self.beta = nn.Parameter(torch.ones(levels, channels))
        self.mix = nn.Conv2d(channels, channels, 1)
        self.filters: Tensor
        self.register_buffer("filters", haar_filters(channels), persistent=False)

    def forward(self, x: Tensor) -> Tensor:
        """(B, C, H, W) -> (B, C, H, W)."""
        out = self.base(x)
        low, features = x, []
        for conv in self.bands:
            bands = haar_transform(low, self.filters)  # (B, 4 C, h, w), half of the level above
            low = bands[:, 0::4]  # (B, C, h, w)
            features.append(conv(bands))
        deeper: Tensor | None = None
        for level in range(self.levels - 1, -1, -1):
            low, *high = features[level].unflatten(1, (-1, 4)).unbind(2)  # (B, C, h, w) each
            low = low if deeper is None else low + deeper
            deeper = inverse_haar_transform(low * self.beta[level][:, None, None], *high)
        return self.mix(out if deeper is None else out + deeper)
