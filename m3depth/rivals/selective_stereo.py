"""Selective-Stereo, on RAFT-Stereo: recurrent units of two kernel sizes, between which attention chooses by the pixel.

Wang, Xu, Jia and Yang: "Selective-Stereo: Adaptive Frequency Information Selection for Stereo Matching", CVPR 2024,
arXiv:2403.00486 (Selective-RAFT); the sizes are those of its released model.

Beside RAFT-Stereo: the contextual spatial attention module weighs the channels of the context at each resolution, and
derives from it a map of where detail matters. Each recurrent unit runs twice, with 1 x 1 and with 3 x 3 kernels, and
its new state is the mean of the two by that map. The context enters the units as an input, not as a bias of the gates.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from m3depth.network.refinement import ConvGRU
from m3depth.rivals.config import SelectiveStereoConfig
from m3depth.rivals.recurrent import MotionEncoder, RecurrentStereo, correction_head, enlarged, halved

REDUCTION = 16  # of the channels inside the channel attention
FEWEST = 8  # least channels inside it, as in the published width: with two, both may start without a gradient
KERNELS = (1, 3)  # of the two units, for detail and for smooth surfaces


class ChannelAttention(nn.Module):
    """Weights of the channels, from their mean and their maximum over the map (Eq. 5)."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        inner = max(FEWEST, channels // REDUCTION)
        self.layers = nn.Sequential(
            nn.Conv2d(channels, inner, 1, bias=False), nn.ReLU(inplace=True), nn.Conv2d(inner, channels, 1, bias=False)
        )

    def forward(self, x: Tensor) -> Tensor:
        """(B, C, H, W) -> (B, C, 1, 1) in [0, 1]."""
        mean, largest = x.mean((2, 3), keepdim=True), x.amax((2, 3), keepdim=True)
        return torch.sigmoid(self.layers(mean) + self.layers(largest))


class SpatialAttention(nn.Module):
    """The map by which the units are mixed, from the mean and the maximum over the channels."""

    def __init__(self) -> None:
        super().__init__()
        self.layer = nn.Conv2d(2, 1, 7, padding=3, bias=False)

    def forward(self, x: Tensor) -> Tensor:
        """(B, C, H, W) -> (B, 1, H, W) in [0, 1]; 1 takes the small kernels alone."""
        return torch.sigmoid(self.layer(torch.cat([x.mean(1, keepdim=True), x.amax(1, keepdim=True)], 1)))


class SelectiveUnit(nn.Module):
    """Two units on the same state, mixed by the attention map (Eq. 4)."""

    def __init__(self, hidden: int, inputs: int) -> None:
        super().__init__()
        self.small, self.large = (ConvGRU(hidden, inputs, kernel) for kernel in KERNELS)

    def forward(self, attention: Tensor, hidden: Tensor, *inputs: Tensor) -> Tensor:
        """Return the new state (B, hidden, H, W); attention: (B, 1, H, W)."""
        x = torch.cat(inputs, 1)
        return attention * self.small(hidden, x) + (1 - attention) * self.large(hidden, x)


class SelectiveUpdate(nn.Module):
    """One step: the three states from coarse to fine, and the correction of the disparity."""

    def __init__(self, config: SelectiveStereoConfig) -> None:
        super().__init__()
        hidden = config.hidden
        samples = config.lookup_levels * (2 * config.lookup_radius + 1)
        self.motion = MotionEncoder(samples, config.motion, hidden)
        self.units = nn.ModuleList([SelectiveUnit(hidden, size * hidden) for size in (3, 3, 2)])
        self.head = correction_head(hidden, config.head)

    def forward(
        self, states: list[Tensor], contexts: list[Tensor], attention: list[Tensor], cells: Tensor, scores: Tensor
    ) -> tuple[list[Tensor], Tensor]:
        """Return the new states, and the corrected disparity.

        Args:
            states: (B, hidden, ...) at 1/4, 1/8 and 1/16.
            contexts: (B, hidden, ...) likewise.
            attention: (B, 1, ...) likewise.
            cells: (B, 1, h, w) disparity [cells].
            scores: (B, samples, h, w) around it.
        """
        fine, middle, coarse = states
        coarse = self.units[2](attention[2], coarse, contexts[2], halved(middle))
        middle = self.units[1](attention[1], middle, contexts[1], halved(fine), enlarged(coarse, middle))
        motion = self.motion(cells, scores)
        fine = self.units[0](attention[0], fine, contexts[0], motion, enlarged(middle, fine))
        return [fine, middle, coarse], cells + self.head(fine).float()


class SelectiveStereo(RecurrentStereo):
    """Selective-Stereo on RAFT-Stereo."""

    config: SelectiveStereoConfig

    def __init__(self, config: SelectiveStereoConfig) -> None:
        super().__init__(config)
        self.channels = ChannelAttention(config.hidden)
        self.pixels = SpatialAttention()
        self.update = SelectiveUpdate(config)

    def inputs(self, contexts: list[Tensor]) -> tuple[list[Tensor], ...]:
        """Return the contexts with weighed channels, (B, hidden, ...), and the attention maps, (B, 1, ...)."""
        weighed = [self.channels(x) * x for x in contexts]
        return weighed, [self.pixels(x) for x in weighed]
