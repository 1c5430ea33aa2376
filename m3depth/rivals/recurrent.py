"""What RAFT-Stereo and the methods on top of it share: encoders, and the loop of their recurrent steps.

Lookup and convex upsampling are those of M3Depth. Unlike the released code, the lookup takes the places of a coarser
level where its cells lie, half a cell aside, and the upsampling repeats the border instead of padding it with zeros.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from m3depth.network.refinement import ConvexUpsampling, CorrelationLookup
from m3depth.rivals.config import RaftStereoConfig
from m3depth.rivals.layers import MASK_SCALE, ResidualBlock, in_float32, stage, start_as_encoder, trunk
from m3depth.rivals.output import SequenceOutput, fading_shares
from m3depth.rivals.rival import SteppedRival

CELL = 4  # side of a cell of the finest grid [px]
SCALES = 3  # resolutions of the recurrent units, 1/4, 1/8 and 1/16
DECAY = 0.9  # of the weight of a step's loss to that of the one before it, with 16 steps (Sec. 3.5)
STRIDES = (1, 1, 2, 2)  # of the encoders' first convolution and of its three stages


def sequence_shares(count: int) -> list[float]:
    """Return the weights of the losses of `count` steps; the first one's does not depend on their number."""
    return fading_shares(count, DECAY ** (15 / max(1, count - 1)))


class ContextEncoder(nn.Module):
    """From the left image, what starts the state of each recurrent unit, and what it gets at every step.

    Args:
        widths: Channels at the image's size, at 1/2, and from 1/4 on.
        hidden: Channels of the outputs.
    """

    def __init__(self, widths: tuple[int, int, int], hidden: int) -> None:
        super().__init__()
        width = widths[2]
        self.trunk = trunk(widths, STRIDES, "group")
        self.coarser = nn.ModuleList([stage(width, width, "group", 2) for _ in range(SCALES - 1)])
        self.outputs = nn.ModuleList([self._outputs(width, hidden, scale) for scale in range(SCALES)])
        start_as_encoder(self)

    @staticmethod
    def _outputs(width: int, hidden: int, scale: int) -> nn.ModuleList:
        """Return the heads of state and context at a scale; the coarsest ones are convolutions alone."""
        last = scale == SCALES - 1
        heads = [
            nn.Sequential(
                nn.Identity() if last else ResidualBlock(width, width, "group"), nn.Conv2d(width, hidden, 3, padding=1)
            )
            for _ in range(2)
        ]
        return nn.ModuleList(heads)

    def forward(self, left: Tensor) -> tuple[list[Tensor], list[Tensor]]:
        """Return states and contexts, (B, hidden, H / 4 / 2^n, W / 4 / 2^n) for n = 0, 1, 2."""
        x = self.trunk(left)
        states, contexts = [], []
        for scale, heads in enumerate(self.outputs):
            assert isinstance(heads, nn.ModuleList)
            x = x if scale == 0 else self.coarser[scale - 1](x)
            states.append(torch.tanh(heads[0](x)))
            contexts.append(F.relu(heads[1](x)))
        return states, contexts


class MotionEncoder(nn.Module):
    """Features of the current disparity and of the matching scores around it.

    Args:
        samples: Number of scores.
        width: Channels inside.
        outputs: Channels of the result, whose last one is the disparity.
    """

    def __init__(self, samples: int, width: int, outputs: int) -> None:
        super().__init__()
        relu = nn.ReLU(inplace=True)
        self.scores = nn.Sequential(nn.Conv2d(samples, width, 1), relu, nn.Conv2d(width, width, 3, padding=1), relu)
        self.disparity = nn.Sequential(
            nn.Conv2d(1, width, 7, padding=3), relu, nn.Conv2d(width, width, 3, padding=1), relu
        )
        self.joined = nn.Sequential(nn.Conv2d(2 * width, outputs - 1, 3, padding=1), relu)

    def forward(self, cells: Tensor, scores: Tensor) -> Tensor:
        """Return (B, outputs, h, w) from a disparity (B, 1, h, w) in cells and scores (B, samples, h, w)."""
        scores, disparity = self.scores(scores), in_float32(self.disparity, cells)
        joined = self.joined(torch.cat([scores, disparity.to(scores.dtype)], 1))
        return torch.cat([joined, cells.to(joined.dtype)], 1)


def correction_head(hidden: int, width: int) -> nn.Sequential:
    """Return the two convolutions that correct the disparity [cells]."""
    return nn.Sequential(
        nn.Conv2d(hidden, width, 3, padding=1), nn.ReLU(inplace=True), nn.Conv2d(width, 1, 3, padding=1)
    )


def halved(state: Tensor) -> Tensor:
    """Return a state at half of its resolution, by means over 3 x 3 cells."""
    return F.avg_pool2d(state, 3, stride=2, padding=1)


def enlarged(state: Tensor, like: Tensor) -> Tensor:
    """Return a state at the resolution of another one."""
    return F.interpolate(state, like.shape[-2:], mode="bilinear", align_corners=True)


class RecurrentStereo(SteppedRival):
    """Encoders and upsampling, around the update of a subclass.

    Attributes:
        update: Takes the states, what `inputs` returned, the disparity (B, 1, h, w) [cells] and the matching scores
            around it (B, samples, h, w); returns the new states and the corrected disparity.
    """

    config: RaftStereoConfig
    update: Callable[..., Any]

    def __init__(self, config: RaftStereoConfig) -> None:
        super().__init__()
        self.config = config
        self.features = nn.Sequential(
            trunk(config.widths, STRIDES, "instance"), nn.Conv2d(config.widths[2], config.features, 1)
        )
        start_as_encoder(self.features)
        self.context = ContextEncoder(config.widths, config.hidden)
        self.upsample = ConvexUpsampling(config.hidden, CELL, MASK_SCALE)

    def inputs(self, contexts: list[Tensor]) -> tuple[list[Tensor], ...]:
        """Return what every step gets of the contexts, (B, hidden, ...) at 1/4, 1/8 and 1/16; defined by a subclass."""
        raise NotImplementedError

    def estimate(self, left: Tensor, right: Tensor, camera: Tensor) -> SequenceOutput:
        """Return the disparity after each step in training and with every_step, after the last one otherwise."""
        c, call = self.config, self.call
        matched = call(self.features, torch.cat([left, right])).float()  # (2 B, features, H / 4, W / 4)
        match_left, match_right = matched.chunk(2)
        with torch.autocast(left.device.type, enabled=False):
            lookup = CorrelationLookup(match_left, match_right, c.lookup_radius, c.lookup_levels)
        states, contexts = call(self.context, left)
        inputs = self.inputs(contexts)
        cells = torch.zeros_like(matched[: len(left), :1])
        maps = []
        count = c.train_steps if self.training else c.steps
        for step in range(count):
            cells = cells.detach()
            scores = in_float32(lookup, cells).to(states[0].dtype)
            states, cells = call(self.update, states, *inputs, cells, scores)
            if self.training or self.every_step or step + 1 == count:
                maps.append(call(self.upsample, states[0], CELL * cells))
        return SequenceOutput(maps, sequence_shares(count)[-len(maps) :])
