"""CREStereo: one displacement map, refined by one recurrent unit at 1/16, 1/8 and 1/4, from coarse to fine.

Li, Wang, Xiong, Cai, Yan, Yang, Liu, Fan and Liu: "Practical Stereo Matching via Cascaded Recurrent Network with
Adaptive Correlation", CVPR 2022, arXiv:2203.11483; the sizes are those of its released model.

The adaptive group correlation layer compares the left features, in four groups of channels, with the right ones in a
small window around the current displacement: 1 x 9 and 3 x 3 cells in turn. At 1/16 and 1/8 the window's cells move by
learned offsets; at 1/16 the features have passed through linear attention within each image, and then between the two.
The displacement has a second, vertical component, by which the method tolerates pairs that are badly rectified; it is
trained to be 0. Each level starts where the coarser one ended. (The released code changes the displacement's sign
between levels, and pads with zeros where it upsamples, instead of repeating the border.) The second pass over a larger
pair, which the paper adds for photographs, is left out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from m3depth.network.refinement import ConvexUpsampling
from m3depth.rivals.config import CreStereoConfig
from m3depth.rivals.layers import MASK_SCALE, in_float32, sampled, start_as_encoder, trunk
from m3depth.rivals.output import SequenceOutput, Truth, fading_shares, mean_over
from m3depth.rivals.rival import SteppedRival

STRIDES = (2, 1, 2, 1)  # of the encoder's first convolution and of its three stages
CELL = 4  # side of a cell of the finest level [px], and factor of the learned upsampling
GROUPS = 4  # of channels that are correlated apart
WINDOWS = ((1, 9), (3, 3))  # heights and widths of the window, in turn [cells]
SAMPLES = 9  # cells of either window
LEAST_COARSE_STEPS = 5  # at 1/16 and at 1/8: with fewer, the windows at 1/16 do not reach 192 px
DECAY = 0.8  # of the weight of a map's loss to that of the next one, as in the released training


@dataclass(frozen=True)
class DisplacementOutput(SequenceOutput):
    """Disparity maps at full size, with the vertical component of each displacement.

    Attributes:
        rows: (B, 1, H, W) each [px].
    """

    rows: Sequence[Tensor] = ()

    def cropped(self, height: int, width: int) -> DisplacementOutput:
        """Cut the maps to an image of height x width [px]."""
        maps, rows = ([x[..., :height, :width] for x in each] for each in (self.maps, self.rows))
        return replace(self, maps=maps, rows=rows)

    def terms(self, truth: Truth) -> dict[str, Tensor]:
        """Return the losses of both components, whose sum is their mean absolute error, by the maps' weights."""
        rows = [s * mean_over(y.abs(), truth.valid) for y, s in zip(self.rows, self.shares, strict=True)]
        return {"disparity": super().terms(truth)["disparity"] / 2, "rows": torch.stack(rows).sum() / 2}


class AttentionLayer(nn.Module):
    """Linear attention of one set of features to another, and a perceptron (LoFTR, Sun et al., CVPR 2021)."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.query, self.key, self.value, self.merge = (nn.Linear(width, width, bias=False) for _ in range(4))
        self.first, self.second = nn.LayerNorm(width), nn.LayerNorm(width)
        self.perceptron = nn.Sequential(
            nn.Linear(2 * width, 2 * width, bias=False), nn.ReLU(), nn.Linear(2 * width, width, bias=False)
        )
        for weight in self.parameters():
            if weight.ndim > 1:
                nn.init.xavier_uniform_(weight)

    def forward(self, x: Tensor, source: Tensor) -> Tensor:
        """Return x, (B, N, C), with what it takes from the source, (B, M, C)."""

        def split(features: Tensor) -> Tensor:
            return features.unflatten(2, (self.heads, -1)).float()

        # softmax is replaced by the kernel elu + 1, so that the cost is linear in N
        query, key = (F.elu(split(y)) + 1 for y in (self.query(x), self.key(source)))
        message = in_float32(attended, query, key, split(self.value(source)))
        message = self.first(self.merge(message.flatten(2).to(x.dtype)))
        return x + self.second(self.perceptron(torch.cat([x, message], 2)))


def attended(query: Tensor, key: Tensor, value: Tensor) -> Tensor:
    """Return the means (B, N, heads, C) of values (B, M, heads, C), weighed by the products of queries and keys."""
    memory = torch.einsum("bnhc,bnhd->bhcd", key, value) / key.shape[1]
    scale = torch.einsum("bnhc,bhc->bnh", query, key.mean(1)).clamp(min=1e-6)
    return torch.einsum("bnhc,bhcd->bnhd", query, memory) / scale[..., None]


def position_code(like: Tensor) -> Tensor:
    """Return the sines and cosines of row and column that are added to features (B, C, H, W), C a multiple of 4."""
    channels, height, width = like.shape[1:]
    rates = torch.exp(torch.arange(0, channels // 2, 2, device=like.device) * (-2 * math.log(10000.0) / channels))
    across, down = (
        torch.arange(1, side + 1, device=like.device) * rates[:, None] for side in (width, height)
    )  # (C / 4, side)
    waves = [
        wave[:, None, :].expand(-1, height, -1) if axis == 0 else wave[:, :, None].expand(-1, -1, width)
        for axis, angles in enumerate((across, down))
        for wave in (angles.sin(), angles.cos())
    ]
    return torch.cat(waves)[None]


class Level(NamedTuple):
    """What the recurrent unit works with at one resolution.

    Attributes:
        left, right: (B, C, h, w) features.
        state: (B, C / 2, h, w), from which it starts.
        context: (B, C / 2, h, w), which it gets at each step.
        offsets: (B, 9, 2, h, w) learned offsets of the window [cells]; None at 1/4.
    """

    left: Tensor
    right: Tensor
    state: Tensor
    context: Tensor
    offsets: Tensor | None


def window_offsets(step: int, like: Tensor) -> Tensor:
    """Return the offsets (9, 2), across and down, of the window of a step [cells]."""
    height, width = WINDOWS[step % 2]
    down, across = torch.meshgrid(
        torch.arange(height, device=like.device) - height // 2, torch.arange(width, device=like.device) - width // 2,
        indexing="ij",
    )  # fmt: skip
    return torch.stack([across.flatten(), down.flatten()], 1).to(like.dtype)


def adaptive_correlation(level: Level, displacement: Tensor, step: int) -> Tensor:
    """Compare left features with right ones in a window around a displacement (AGCL).

    Args:
        level: The features and the learned offsets.
        displacement: (B, 2, h, w) across and down [cells].
        step: Number of the step, of which the shape of the window depends.

    Returns:
        (B, 36, h, w): the mean product of each group of channels, for each cell of the window.
    """
    height, width = level.left.shape[-2:]
    rows = torch.arange(height, dtype=torch.float32, device=displacement.device)
    columns = torch.arange(width, dtype=torch.float32, device=displacement.device)
    grid = torch.stack([columns.expand(height, -1), rows[:, None].expand(-1, width)])  # (2, h, w)
    place = grid + displacement  # (B, 2, h, w)
    offsets = window_offsets(step, place)
    if level.offsets is None:  # the window is that of the right features at the displacement, warped
        tall, wide = WINDOWS[step % 2]
        warped = F.pad(sampled(level.right, place), (wide // 2, wide // 2, tall // 2, tall // 2), mode="replicate")
        rights = [
            warped[..., i : i + height, j : j + width] for i in range(tall) for j in range(wide)
        ]  # (B, C, h, w) each
    else:
        places = place[:, None] + offsets[:, :, None, None] + level.offsets  # (B, 9, 2, h, w)
        samples = sampled(level.right, places.transpose(1, 2).flatten(2, 3)).unflatten(2, (SAMPLES, height))
        rights = list(samples.unbind(2))
    scores = [(level.left * right).unflatten(1, (GROUPS, -1)).mean(2) for right in rights]
    return torch.stack(scores, 2).flatten(1, 2)


class SeparableGRU(nn.Module):
    """A gated recurrent unit of 1 x 5 kernels, and then one of 5 x 1 kernels (RAFT)."""

    def __init__(self, hidden: int, inputs: int) -> None:
        super().__init__()
        shapes = (((1, 5), (0, 2)), ((5, 1), (2, 0)))
        self.gates = nn.ModuleList([nn.Conv2d(hidden + inputs, 2 * hidden, k, padding=p) for k, p in shapes])
        self.candidates = nn.ModuleList([nn.Conv2d(hidden + inputs, hidden, k, padding=p) for k, p in shapes])

    def forward(self, hidden: Tensor, x: Tensor) -> Tensor:
        """Return the new state (B, hidden, h, w) from the old one and inputs (B, inputs, h, w)."""
        for gates, candidate in zip(self.gates, self.candidates, strict=True):
            update, reset = torch.sigmoid(gates(torch.cat([hidden, x], 1))).chunk(2, 1)
            proposed = torch.tanh(candidate(torch.cat([reset * hidden, x], 1)))
            hidden = hidden + update * (proposed - hidden)
        return hidden


class CascadeUpdate(nn.Module):
    """One step of the recurrent unit that all levels share, and its correction of the displacement."""

    def __init__(self, hidden: int) -> None:
        super().__init__()
        relu, half, wide = nn.ReLU(), hidden // 2, 3 * hidden // 2
        self.scores = nn.Sequential(
            nn.Conv2d(GROUPS * SAMPLES, 2 * hidden, 1), relu, nn.Conv2d(2 * hidden, wide, 3, padding=1), relu
        )
        self.displacement = nn.Sequential(
            nn.Conv2d(2, hidden, 7, padding=3), relu, nn.Conv2d(hidden, half, 3, padding=1), relu
        )
        self.joined = nn.Sequential(nn.Conv2d(half + wide, hidden - 2, 3, padding=1), relu)
        self.unit = SeparableGRU(hidden, 2 * hidden)
        self.head = nn.Sequential(
            nn.Conv2d(hidden, 2 * hidden, 3, padding=1), relu, nn.Conv2d(2 * hidden, 2, 3, padding=1)
        )

    def forward(self, state: Tensor, context: Tensor, displacement: Tensor, scores: Tensor) -> tuple[Tensor, Tensor]:
        """Return the new state and the corrected displacement, (B, hidden, h, w) and (B, 2, h, w)."""
        looked, moved = self.scores(scores.to(state.dtype)), in_float32(self.displacement, displacement)
        motion = self.joined(torch.cat([looked, moved.to(looked.dtype)], 1))
        state = self.unit(state, torch.cat([context, motion, displacement.to(motion.dtype)], 1))
        return state, displacement + self.head(state).float()


class CreStereo(SteppedRival):
    """CREStereo."""

    config: CreStereoConfig

    def __init__(self, config: CreStereoConfig) -> None:
        super().__init__()
        self.config = config
        width = config.features
        self.features = nn.Sequential(
            trunk(config.widths, STRIDES, "instance", projected=True), nn.Conv2d(config.widths[2], width, 1)
        )
        start_as_encoder(self.features)
        self.within, self.between = (AttentionLayer(width, config.heads) for _ in range(2))
        self.offsets = nn.ModuleList([nn.Conv2d(width, 2 * SAMPLES, 3, padding=1) for _ in range(2)])
        self.update = CascadeUpdate(width // 2)
        self.upsample = ConvexUpsampling(width // 2, CELL, MASK_SCALE)

    def estimate(self, left: Tensor, right: Tensor, camera: Tensor) -> DisplacementOutput:
        """Return the displacement after each step of all levels, or outside of training the last one alone.

        With every_step, all are returned in any case.
        """
        features = self.call(self.features, torch.cat([left, right])).float()  # (2 B, C, H / 4, W / 4)
        steps = self.config.train_steps if self.training else self.config.steps
        every = self.training or self.every_step
        maps: list[Tensor] = []
        previous: Tensor | None = None  # (B, 2, 2 h, 2 w) of the next level's h x w, in cells of half its size
        coarse = max(LEAST_COARSE_STEPS, steps // 2)
        for scale, count in ((4, coarse), (2, coarse), (1, steps)):  # cells of 1/4 along one of the level
            level = self._level(features, scale)
            if previous is None:
                moved = torch.zeros_like(level.left[:, :2])
            else:
                moved = F.interpolate(previous, level.left.shape[-2:], mode="bilinear", align_corners=True) / 2
            state = level.state
            for step in range(count):
                moved = moved.detach()
                scores = adaptive_correlation(level, moved, step)
                state, moved = self.call(self.update, state, level.context, moved, scores)
                last = step + 1 == count
                if every or last:
                    previous = self.call(self.upsample, state, CELL * moved)  # 4 times the level's size, in its cells
                    if every or scale == 1:
                        size = left.shape[-2:]
                        whole = previous if scale == 1 else scale * F.interpolate(
                            previous, size, mode="bilinear", align_corners=True
                        )  # fmt: skip
                        maps.append(whole)
        shares = fading_shares(len(maps), DECAY)
        return DisplacementOutput([-x[:, :1] for x in maps], shares, rows=[x[:, 1:] for x in maps])

    def _level(self, features: Tensor, scale: int) -> Level:
        """Return what the recurrent unit works with at 1 / (4 scale), from features (2 B, C, H / 4, W / 4)."""
        coarse = features if scale == 1 else F.avg_pool2d(features, scale)
        left, right = coarse.chunk(2)
        state, context = features.chunk(2)[0].chunk(2, 1)
        state, context = torch.tanh(state), F.relu(context)
        if scale == 1:
            return Level(left, right, state, context, None)
        state, context = (F.avg_pool2d(x, scale) for x in (state, context))
        offsets = torch.sigmoid(self.offsets[0 if scale == 4 else 1](left)).float() * 2 - 1
        if scale == 4:
            left, right = self.call(self._attended, left, right)
        return Level(left.float(), right.float(), state, context, offsets.unflatten(1, (SAMPLES, 2)))

    def _attended(self, left: Tensor, right: Tensor) -> tuple[Tensor, Tensor]:
        """Return the features of both images after attention within each, and between the two."""
        code, size = position_code(left), left.shape[-2:]
        left, right = ((x + code).flatten(2).transpose(1, 2) for x in (left, right))  # (B, h w, C)
        left, right = (self.within(x, x) for x in (left, right))
        left = self.between(left, right)
        right = self.between(right, left)
        left, right = (x.transpose(1, 2).unflatten(2, size) for x in (left, right))
        return left, right
