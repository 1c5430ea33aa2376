"""Cost volume, its aggregation, and soft argmin (paper, Sec. IV-B)."""

from __future__ import annotations

from itertools import product

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from m3depth.network.backbone import conv_block, group_norm
from m3depth.network.config import M3DepthConfig
from m3depth.network.geometry import unit


def matchable(features: Tensor) -> Tensor:
    """Centre the features of a pair and scale each pixel's vector to length sqrt(C), so that products are cosines.

    Otherwise the common mean of the channels and the length of the vectors dominate the correlation: with random
    weights on Mars scenes the soft argmin is then off by 25 px in the median, and by 4 px with this step.

    Args:
        features: (2 B, C, H, W), left images first.

    Returns:
        (2 B, C, H, W), in the same order.
    """
    return centred(features, pair_mean(features))


def pair_mean(features: Tensor) -> Tensor:
    """Return the mean of each channel over both images of a pair, (2 B, C, 1, 1); features: (2 B, C, H, W)."""
    left, right = features.mean((2, 3), keepdim=True).chunk(2)
    return torch.cat([left + right, left + right]) / 2


def centred(features: Tensor, mean: Tensor) -> Tensor:
    """Return features (2 B, C, H, W) less a mean (2 B, C, 1, 1), each pixel's vector scaled to length sqrt(C)."""
    return unit(features - mean) * features.shape[1] ** 0.5


def group_correlation_volume(left: Tensor, right: Tensor, hypotheses: int, groups: int) -> Tensor:
    """Correlate left pixel x with right pixel x - i by groups of channels, for i = 0 ... hypotheses - 1.

    Built by shift and slice, so that it can be exported.

    Args:
        left, right: (B, C, H, W), C a multiple of groups.
        hypotheses: D, the number of shifts.
        groups: G, the number of groups.

    Returns:
        (B, G, D, H, W): the mean product over the C / G channels of each group; 0 where x - i lies outside.
    """
    width = right.shape[-1]
    # Contiguous, so that the channels of a group are a view: with the channels last, each product would be copied.
    left, right = (features.contiguous().unflatten(1, (groups, -1)) for features in (left, right))
    shifted = (F.pad(right, (i, 0))[..., :width] for i in range(hypotheses))
    # One hypothesis after the other: the products of all channels at once would take by far the most memory.
    return torch.stack([(left * other).mean(2) for other in shifted], 2)


def soft_argmin(logits: Tensor, step: float) -> Tensor:
    """Return the expected disparity under the softmax of the matching scores.

    Args:
        logits: (B, D, H, W), larger is better; slice i stands for i * step pixels.
        step: Disparity between two slices [px].

    Returns:
        (B, 1, H, W) [px].
    """
    index = torch.arange(logits.shape[1], dtype=logits.dtype, device=logits.device)
    return (logits.softmax(1) * index[:, None, None]).sum(1, keepdim=True) * step


class OutputHead(nn.Module):
    """Transposed convolutions, 4 x 4 with stride 2, over each slice of the volume (paper, Table I, Upsample1 to 3).

    They start as bilinear interpolation of each channel.

    Args:
        groups: G, channels of the volume.
        doublings: n, how often height and width are doubled.
    """

    def __init__(self, groups: int, doublings: int) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            *(nn.ConvTranspose3d(groups, groups, (1, 4, 4), (1, 2, 2), (0, 1, 1)) for _ in range(doublings))
        )
        taps = torch.tensor([0.25, 0.75, 0.75, 0.25])
        for layer in self.layers:
            with torch.no_grad():
                layer.get_parameter("weight").copy_(torch.eye(groups)[:, :, None, None, None] * torch.outer(taps, taps))
                layer.get_parameter("bias").zero_()

    def forward(self, volume: Tensor) -> Tensor:
        """(B, G, D, H, W) -> (B, G, D, 2^n H, 2^n W)."""
        return self.layers(volume)


class ScoreConvolution(nn.Conv3d):
    """A 3-D convolution of all groups to one score, k x k x k with zeros around.

    It is computed as k^3 weighted sums of the groups, which are shifted and added in float32, since cuDNN and oneDNN
    are slow where a convolution has one output channel, above all in its gradients.

    Args:
        groups: G, channels of the volume.
        kernel: k, odd.
    """

    def __init__(self, groups: int, kernel: int) -> None:
        super().__init__(groups, 1, kernel, padding=kernel // 2)

    def forward(self, volume: Tensor) -> Tensor:
        """(B, G, D, H, W) -> (B, 1, D, H, W)."""
        side, middle = self.kernel_size[0], self.kernel_size[0] // 2
        weight = self.get_parameter("weight")[0].flatten(1)
        sums = torch.einsum("bgdhw,gk->kbdhw", volume.to(weight), weight)  # OpenVINO multiplies one precision alone
        scores: Tensor = self.get_parameter("bias")
        for tap, part in zip(product(range(side), repeat=3), sums.unbind()):
            shift = [sign * (middle - position) for position in reversed(tap) for sign in (1, -1)]  # as F.pad takes it
            scores = scores + F.pad(part, shift).float()
        return scores[:, None]


class Aggregation(nn.Module):
    """C_0 -> C_1 -> P_1 by 3-D convolutions, then P_2 = P_1 + a residual from context.

    The residual is computed in 2-D, over all hypotheses of P_1 and the left features, with growing dilations. This is
    the role of DPSNet's context network, at a fraction of the cost of one pass a slice. config.output_head sets how
    often C_1 is doubled in size, config.score_kernel the convolution from C_1 to P_1 (1 is a weighted sum of the
    groups).
    """

    def __init__(self, config: M3DepthConfig) -> None:
        super().__init__()
        groups, width, residual_width = config.groups, config.volume_width, config.residual_width
        # oneDNN is 20 times slower on 3-D convolutions whose channels are not multiples of 16: keep widths at 16, 32...
        self.first = nn.Sequential(
            nn.Conv3d(groups, width, 3, padding=1, bias=False), group_norm(width), nn.ReLU(inplace=True)
        )
        self.second = nn.Sequential(nn.Conv3d(width, groups, 3, padding=1, bias=False), group_norm(groups))
        # At the start P_1 is the plain correlation, sharp enough for the softmax to have a peak.
        nn.init.zeros_(self.second[1].get_parameter("weight"))
        self.head = OutputHead(groups, config.output_head) if config.output_head else None
        self.score: nn.Parameter | ScoreConvolution
        if config.score_kernel == 1:
            self.score = nn.Parameter(torch.full((groups,), 20.0 / groups))
        else:
            middle = config.score_kernel // 2
            self.score = ScoreConvolution(groups, config.score_kernel)
            with torch.no_grad():
                self.score.weight.zero_()[:, :, middle, middle, middle] = 20.0 / groups
                self.score.get_parameter("bias").zero_()
        self.residual_width = residual_width
        if residual_width:
            self.context = nn.Sequential(
                conv_block(config.hypotheses + config.channels[2], residual_width),
                *(conv_block(residual_width, residual_width, dilation=d) for d in (2, 4, 8, 1)),
            )
            self.residual = nn.Conv2d(residual_width, config.hypotheses, 3, padding=1)
            nn.init.zeros_(self.residual.weight)

    def forward(self, volume: Tensor, left: Tensor) -> tuple[Tensor, Tensor, Tensor | None]:
        """Aggregate the cost volume.

        Args:
            volume: C_0, (B, G, D, H, W).
            left: Left features on the volume's grid, (B, C, H, W).

        Returns:
            The volume for SNNet: C_0 or, with an output head, the enlarged C_1, (B, G, D, h, w).
            The scores P_2 before the softmax, (B, D, h, w).
            The context features, (B, residual_width, h, w), or None without them.
        """
        aggregated = volume + self.second(self.first(volume))  # C_1, (B, G, D, H, W)
        if self.head is not None:
            volume = aggregated = self.head(aggregated)  # (B, G, D, h, w)
            left = F.interpolate(left, scale_factor=2 ** len(self.head.layers), mode="bilinear")
        if isinstance(self.score, ScoreConvolution):
            scores = self.score(aggregated)[:, 0]
        else:
            scores = (aggregated * self.score[:, None, None, None]).sum(1)
        if not self.residual_width:
            return volume, scores, None
        context = self.context(torch.cat([scores, left], 1))  # (B, residual_width, h, w)
        return volume, scores + self.residual(context), context
