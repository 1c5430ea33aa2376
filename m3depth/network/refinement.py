"""Iterative refinement of disparity and normals (paper, Sec. IV-D) at a quarter of the resolution."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from m3depth.network.checkpointing import Caller, direct
from m3depth.network.config import M3DepthConfig
from m3depth.network.cost_volume import matchable
from m3depth.network.geometry import normals_from_disparity, relief, unit
from m3depth.network.row_bands import by_rows

CELL = 4  # side of a cell of the refined grid [px of the image]
DISPARITY_SCALE = 64.0  # [px] brings disparities to the size of the other inputs
KEPT_SCORES = 50_000_000  # most matching scores that are kept between steps on a CPU, 200 MB
BAND_SCORES = 4_000_000  # matching scores that are computed at a time where they are not kept
GPU_FACTOR = 10  # times as many of both on a GPU, which has the memory, and loses time with each small operation


class CorrelationLookup:
    """Matching scores around the current disparity, from all pairs of pixels on the same row.

    A sample at offset k compares left pixel x with right pixel x - d - k. Scores between pixels are interpolated, and
    are 0 outside the image.

    Args:
        left, right: (B, C, H, W) features of one grid.
        radius: Offsets run from -radius to radius.
        levels: Each level after the first halves the right image's width, so that the same number of samples reaches
            farther.
    """

    def __init__(self, left: Tensor, right: Tensor, radius: int, levels: int) -> None:
        self.radius = radius
        self.pad = 2 * radius + 2
        # The scores are the largest maps. Scaling, pooling and padding the features instead avoids copies of them.
        self.left = (left * left.shape[1] ** -0.5).permute(0, 2, 3, 1)  # (B, H, W, C)
        self.rights = []
        for level in range(levels):
            if level:
                right = F.avg_pool2d(right, (1, 2), ceil_mode=True)
            self.rights.append(F.pad(right, (self.pad, self.pad)).permute(0, 2, 1, 3))  # (B, H, C, W + 2 pad)
        height, width = left.shape[-2:]
        count = left.shape[0] * height * width * sum(padded.shape[-1] for padded in self.rights)
        more = 1 if left.device.type == "cpu" else GPU_FACTOR
        # All scores, or none where they take too much memory: each call then computes those of a few rows at a time.
        keep = torch.is_grad_enabled() or torch.jit.is_tracing() or count <= more * KEPT_SCORES
        self.pyramid = [self.left @ padded for padded in self.rights] if keep else None  # (B, H, W, W + 2 pad) each
        self.rows = max(1, height * more * BAND_SCORES // max(count, 1))

    def __call__(self, disparity: Tensor) -> Tensor:
        """Look up the scores around a disparity.

        Args:
            disparity: (B, 1, H, W) in cells of this grid.

        Returns:
            (B, levels (2 radius + 1), H, W).
        """
        column = torch.arange(disparity.shape[-1], dtype=torch.float32, device=disparity.device)
        position = column - disparity[:, 0].float()  # (B, H, W)
        if self.pyramid is not None:
            return self._samples(self.pyramid, position).permute(0, 3, 1, 2)
        bands = []
        for first in range(0, position.shape[1], self.rows):
            band = slice(first, first + self.rows)
            scores = [self.left[:, band] @ padded[:, band] for padded in self.rights]
            bands.append(self._samples(scores, position[:, band]))
        return torch.cat(bands, 1).permute(0, 3, 1, 2)

    def _samples(self, pyramid: list[Tensor], position: Tensor) -> Tensor:
        """Return the scores (B, h, W, samples) of some rows at a position (B, h, W); pyramid: (B, h, W, ...) each."""
        offsets = torch.arange(2 * self.radius + 2, device=position.device)
        samples = []
        for scores in pyramid:
            start = position.floor()
            fraction = (position - start)[..., None]
            last = scores.shape[-1] - 2 * self.pad + self.radius
            # Clamped as integers, so that a NaN gets an index in range too; its fraction stays NaN.
            first = start.long().clamp(-(self.radius + 2), last) - self.radius + self.pad
            taken = scores.gather(3, first[..., None] + offsets).float()
            samples.append(taken[..., :-1] + fraction * (taken[..., 1:] - taken[..., :-1]))
            position = (position - 0.5) / 2  # cell j of the next level covers cells 2 j and 2 j + 1
        return torch.cat(samples, 3)


class ConvGRU(nn.Module):
    """Convolutional gated recurrent unit, H_t+1 = ConvGRU(D_t, N_t, H_0, H_t) (paper, Eq. 20):

    z, r = sigmoid(W [H_t, x] + c), q = tanh(W_q [r H_t, x] + c_q), H_t+1 = (1 - z) H_t + z q.

    x is computed from D_t and N_t. c and c_q are computed once, from the left features from which H_0 comes too, as in
    RAFT; H_0 itself is the first state.

    Args:
        hidden: Channels of the state.
        inputs: Channels of x.
        kernel: Side of the kernels, odd.
    """

    def __init__(self, hidden: int, inputs: int, kernel: int = 3) -> None:
        super().__init__()
        self.gates = nn.Conv2d(hidden + inputs, 2 * hidden, kernel, padding=kernel // 2)
        self.candidate = nn.Conv2d(hidden + inputs, hidden, kernel, padding=kernel // 2)

    def forward(self, hidden: Tensor, x: Tensor, context: Tensor | None = None) -> Tensor:
        """Return the new hidden state, (B, C, H, W).

        Args:
            hidden: H_t, (B, C, H, W).
            x: (B, inputs, H, W).
            context: (B, 3 C, H, W), added to update, reset and candidate; None adds nothing.
        """
        size = hidden.shape[1]
        gates = self.gates(torch.cat([hidden, x], 1))
        if context is not None:
            gates = gates + context[:, : 2 * size]
        update, reset = torch.sigmoid(gates).chunk(2, 1)
        candidate = self.candidate(torch.cat([reset * hidden, x], 1))
        if context is not None:
            candidate = candidate + context[:, 2 * size :]
        return hidden + update * (torch.tanh(candidate) - hidden)


def head(inputs: int, width: int, outputs: int) -> nn.Sequential:
    """Return two 3 x 3 convolutions that start as a small correction.

    Args:
        inputs: Channels of the input.
        width: Channels between the two convolutions.
        outputs: Channels of the correction.
    """
    last = nn.Conv2d(width, outputs, 3, padding=1)
    nn.init.normal_(last.weight, std=1e-3)
    nn.init.constant_(last.get_parameter("bias"), 0.0)
    return nn.Sequential(nn.Conv2d(inputs, width, 3, padding=1), nn.ReLU(inplace=True), last)


class RefinementStep(nn.Module):
    """One update of disparity, normals and hidden state (paper, Eq. 17 to 20):

    H_t+1 = ConvGRU(D_t, N_t, H_0, H_t), D_t+1 = D_t + Phi_d, N_t+1 = N_t + Phi_n (of unit length).

    The step gets D_t and N_t. With config.implied_geometry it also gets the relief of D_t and the normals that D_t
    implies; config.lookup_levels and config.lookup_radius add correlations around D_t. With config.heads_see_all the
    heads get D_t or N_t and H_0 beside the hidden state, as in the paper; otherwise the hidden state alone (and N_t for
    Phi_n).

    Args:
        config: Sizes of the network.
        cell: Side of a cell of the step's grid [px of the image].
    """

    def __init__(self, config: M3DepthConfig, cell: int) -> None:
        super().__init__()
        hidden, motion = config.hidden, config.motion
        self.cell, self.implied, self.all_to_heads = cell, config.implied_geometry, config.heads_see_all
        samples = config.lookup_levels * (2 * config.lookup_radius + 1)
        self.correlation = nn.Sequential(nn.Conv2d(samples, motion, 1), nn.ReLU(inplace=True)) if samples else None
        inputs = 8 if self.implied else 4
        self.geometry = nn.Sequential(nn.Conv2d(inputs, motion // 2, 3, padding=1), nn.ReLU(inplace=True))
        self.motion = nn.Sequential(
            nn.Conv2d((motion if samples else 0) + motion // 2, motion, 3, padding=1),
            nn.ReLU(inplace=True),
        )
        self.gru = ConvGRU(hidden, motion)
        more = hidden if self.all_to_heads else 0
        self.disparity = head(hidden + more + (1 if self.all_to_heads else 0), hidden, 1)
        self.normal = head(hidden + more + 3, hidden, 3)

    def forward(
        self,
        hidden: Tensor,
        context: Tensor,
        first: Tensor,
        disparity: Tensor,
        normal: Tensor,
        lookup: CorrelationLookup | None,
        camera: Tensor,
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Take one step.

        Args:
            hidden: H_t, (B, hidden, H, W).
            context: (B, 3 hidden, H, W), c and c_q of ConvGRU.
            first: H_0, (B, hidden, H, W).
            disparity: D_t, (B, 1, H, W) [px of the full-size image].
            normal: N_t, (B, 3, H, W).
            lookup: Matching scores; None without them.
            camera: (B, 4) of this grid.

        Returns:
            The new hidden state, disparity and normals, of the same shapes.
        """
        # Gradients pass through the hidden state only, as in RAFT: each step learns to correct what it is given.
        disparity, normal = disparity.detach(), normal.detach()
        dtype = hidden.dtype
        geometry = [disparity / DISPARITY_SCALE, normal]
        if self.implied:
            geometry = [geometry[0], relief(disparity), normal, normals_from_disparity(disparity, camera)]
        inputs = [self.geometry(torch.cat(geometry, 1).to(dtype))]  # (B, motion / 2, H, W)
        if self.correlation is not None and lookup is not None:
            samples = lookup(disparity / self.cell).to(dtype, memory_format=torch.channels_last)
            inputs.insert(0, self.correlation(samples))  # (B, motion, H, W)
        hidden = self.gru(hidden, self.motion(torch.cat(inputs, 1)), context)
        to_disparity, to_normal = [hidden], [hidden, normal.to(dtype)]
        if self.all_to_heads:
            to_disparity += [first, geometry[0].to(dtype)]
            to_normal.insert(1, first)
        disparity = (disparity + self.cell * self.disparity(torch.cat(to_disparity, 1)).float()).clamp(min=0)
        normal = unit(normal + self.normal(torch.cat(to_normal, 1)).float())
        return hidden, disparity, normal


class ConvexUpsampling(nn.Module):
    """Upsampling by learned weights: a fine pixel is a convex combination of 3 x 3 coarse ones (RAFT).

    Args:
        hidden: Channels of the state from which the weights are computed.
        factor: Fine pixels along the side of a coarse one.
        scale: Factor of the weights before their softmax.
    """

    def __init__(self, hidden: int, factor: int, scale: float = 1.0) -> None:
        super().__init__()
        self.factor, self.scale = factor, scale
        self.weights = nn.Sequential(
            nn.Conv2d(hidden, 2 * hidden, 3, padding=1),
            nn.ReLU(inplace=True),
            nn.Conv2d(2 * hidden, 9 * factor**2, 1),
        )

    def forward(self, hidden: Tensor, maps: Tensor) -> Tensor:
        """Upsample maps (B, M, H, W) to (B, M, factor H, factor W), by weights from the hidden state (B, C, H, W)."""
        height = hidden.shape[-2]
        padded = F.pad(maps, (1, 1, 1, 1), mode="replicate")
        # the rows above, of and below each row, (B, 3 M, H, W + 2)
        beside = torch.cat([padded[:, :, k : k + height] for k in range(3)], 1)
        weights = self.weights(hidden)
        return by_rows(self._combined, weights if self.scale == 1 else self.scale * weights, beside)

    def _combined(self, weights: Tensor, beside: Tensor) -> Tensor:
        """Return (B, M, f h, f W) from weights (B, 9 f f, h, W), before the softmax, and maps (B, 3 M, h, W + 2)."""
        width = weights.shape[-1]
        shares = weights.float().contiguous().unflatten(1, (9, -1)).softmax(1)
        above = beside.unflatten(1, (3, -1))
        out = beside.new_zeros(())
        for k, share in enumerate(shares.unbind(1)):  # (B, f f, h, W) each
            neighbour = above[:, k // 3, :, :, k % 3 : k % 3 + width]
            out = torch.addcmul(out, share[:, None], neighbour[:, :, None])  # (B, M, f f, h, W)
        return F.pixel_shuffle(out.flatten(1, 2), self.factor)


class Refinement(nn.Module):
    """Context, T recurrent steps and the upsampling to full size. H_0 comes from the left features at 1/4 and 1/8.

    Without steps (config.refine_steps 0), the maps are upsampled as they are, and H_0 is the state from which learned
    upsampling and the fine correction take what they know of the image.
    """

    def __init__(self, config: M3DepthConfig) -> None:
        super().__init__()
        hidden, quarter = config.hidden, config.channels[1]
        self.radius, self.levels = config.lookup_radius, config.lookup_levels
        self.match = nn.Conv2d(quarter, config.lookup_channels, 3, padding=1) if self.levels else None
        self.coarse = nn.Conv2d(config.coarse_width, quarter, 1)
        self.context = nn.Sequential(
            nn.Conv2d(2 * quarter, 2 * hidden, 3, padding=1),
            nn.ReLU(inplace=True),
            nn.Conv2d(2 * hidden, 2 * hidden if config.refine_steps else hidden, 1),
        )
        self.bias = nn.Conv2d(hidden, 3 * hidden, 3, padding=1) if config.refine_steps else None
        self.step = RefinementStep(config, CELL) if config.refine_steps else None
        self.decisions = nn.Sequential(
            nn.Conv2d(hidden + quarter, hidden, 3, padding=1), nn.ReLU(inplace=True), nn.Conv2d(hidden, 2, 1)
        )
        self.upsample = ConvexUpsampling(hidden, CELL) if config.convex_upsampling else None

    def forward(
        self, left: Tensor, right: Tensor, coarse: Tensor, disparity: Tensor, normal: Tensor, camera: Tensor,
        count: int, call: Caller = direct,
    ) -> tuple[list[tuple[Tensor, Tensor]], Tensor, Tensor]:  # fmt: skip
        """Refine disparity and normals.

        Args:
            left, right: (B, C4, h, w) features at 1/4.
            coarse: (B, coarse_width, h / 2, w / 2) left features and context at 1/8.
            disparity: (B, 1, h, w) starting map [px of the full-size image].
            normal: (B, 3, h, w) starting map.
            camera: (B, 4) of the grid at 1/4.
            count: T, the number of steps; without recurrent steps in the network, none are taken.
            call: How a part of the network is called: `direct` or `recomputed`.

        Returns:
            The (disparity, normal) of every step, at 1/4.
            (B, 6, 4 h, 4 w): disparity, normal (not normalised), confidence logit, sky logit.
            The hidden state, (B, hidden, h, w).
        """
        wide = F.interpolate(self.coarse(coarse), left.shape[-2:], mode="bilinear")  # (B, C4, h, w)
        hidden = self.context(torch.cat([left, wide], 1))  # (B, hidden, h, w), or twice as many channels with steps
        history = []
        if self.bias is None or self.step is None:
            hidden = torch.tanh(hidden)
        else:
            lookup = self._lookup(left, right)
            hidden, context = hidden.chunk(2, 1)
            first = hidden = torch.tanh(hidden)
            bias = self.bias(F.relu(context))  # (B, 3 hidden, h, w)
            for _ in range(count):
                hidden, disparity, normal = call(self.step, hidden, bias, first, disparity, normal, lookup, camera)
                history.append((disparity, normal))
            lookup = None  # frees its memory before the upsampling needs some
        decisions = self.decisions(torch.cat([hidden, wide], 1)).float()  # (B, 2, h, w)
        maps = torch.cat([disparity, normal, decisions], 1)  # (B, 6, h, w)
        if self.upsample is None:
            return history, F.interpolate(maps, scale_factor=float(CELL), mode="bilinear"), hidden
        return history, call(self.upsample, hidden, maps), hidden

    def _lookup(self, left: Tensor, right: Tensor) -> CorrelationLookup | None:
        """Return the matching scores of features (B, C4, h, w); None where the steps do without them."""
        if self.match is None:
            return None
        match_left, match_right = matchable(self.match(torch.cat([left, right])).float()).chunk(2)
        return CorrelationLookup(match_left, match_right, self.radius, self.levels)
