"""Parts of several rivals: the encoders of RAFT (Teed and Deng, ECCV 2020), features between cells, precision."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Literal

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from m3depth.network.backbone import group_norm

Normalisation = Literal["instance", "group"]
MASK_SCALE = 0.25  # factor of the weights of the learned upsampling, before their softmax, as in RAFT


def normalisation(kind: Normalisation, channels: int) -> nn.Module:
    """Return instance normalisation without parameters, or group normalisation with them."""
    return nn.InstanceNorm2d(channels) if kind == "instance" else group_norm(channels)


class ResidualBlock(nn.Module):
    """Two 3 x 3 convolutions beside a skip, which is a 1 x 1 convolution where the shape changes.

    Args:
        inputs: Channels of the input.
        outputs: Channels of the output.
        kind: Normalisation.
        stride: Stride of the first convolution.
        projected: Whether the skip is a convolution even where the shape stays.
    """

    def __init__(
        self, inputs: int, outputs: int, kind: Normalisation, stride: int = 1, projected: bool = False
    ) -> None:
        super().__init__()
        self.body = nn.Sequential(
            nn.Conv2d(inputs, outputs, 3, stride, padding=1), normalisation(kind, outputs), nn.ReLU(inplace=True),
            nn.Conv2d(outputs, outputs, 3, padding=1), normalisation(kind, outputs), nn.ReLU(inplace=True),
        )  # fmt: skip
        self.skip: nn.Module = nn.Identity()
        if projected or stride != 1 or inputs != outputs:
            self.skip = nn.Sequential(nn.Conv2d(inputs, outputs, 1, stride), normalisation(kind, outputs))

    def forward(self, x: Tensor) -> Tensor:
        """(B, inputs, H, W) -> (B, outputs, H / stride, W / stride)."""
        return F.relu(self.skip(x) + self.body(x))


def stage(inputs: int, outputs: int, kind: Normalisation, stride: int = 1, projected: bool = False) -> nn.Sequential:
    """Return two residual blocks, of which the first has the stride; arguments as of ResidualBlock."""
    return nn.Sequential(
        ResidualBlock(inputs, outputs, kind, stride, projected),
        ResidualBlock(outputs, outputs, kind, projected=projected),
    )


def trunk(widths: Sequence[int], strides: Sequence[int], kind: Normalisation, projected: bool = False) -> nn.Sequential:
    """Return a 7 x 7 convolution and a stage for each width.

    Args:
        widths: Channels of the stages; the convolution has those of the first.
        strides: Stride of the convolution and of each stage.
        kind: Normalisation.
        projected: Whether every skip is a convolution.
    """
    first, *rest = strides
    layers: list[nn.Module] = [
        nn.Conv2d(3, widths[0], 7, first, padding=3), normalisation(kind, widths[0]), nn.ReLU(inplace=True)
    ]  # fmt: skip
    inputs = widths[0]
    for width, stride in zip(widths, rest, strict=True):
        layers.append(stage(inputs, width, kind, stride, projected))
        inputs = width
    return nn.Sequential(*layers)


def summed_inputs(layer: nn.Linear | nn.modules.conv._ConvNd) -> float:
    """Return how many inputs an output of a layer sums; a transposed convolution spreads its kernel by its stride."""
    if isinstance(layer, nn.modules.conv._ConvTransposeNd):
        return layer.weight[:, 0].numel() / math.prod(layer.stride)
    return layer.weight[0].numel()


def start_as_encoder(module: nn.Module) -> None:
    """Draw the weights of all convolutions of an encoder as RAFT does (He et al., by the number of outputs)."""
    for layer in module.modules():
        if isinstance(layer, nn.Conv2d):
            nn.init.kaiming_normal_(layer.weight, mode="fan_out", nonlinearity="relu")


def start_as_he(module: nn.Module, slope: float = 0.0) -> None:
    """Draw the weights of all convolutions so that rectifiers preserve the variance (He et al., 2015).

    Args:
        module: Holds the convolutions, each with a bias, which starts at 0.
        slope: Slope of the rectifiers below 0.
    """
    for layer in module.modules():
        if isinstance(layer, nn.Conv2d | nn.ConvTranspose2d):
            nn.init.normal_(layer.weight, std=math.sqrt(2 / (1 + slope**2) / summed_inputs(layer)))
            nn.init.zeros_(layer.get_parameter("bias"))


def start_small(layer: nn.Module) -> None:
    """Draw small weights for the last layer of a correction, which then starts near zero."""
    nn.init.normal_(layer.get_parameter("weight"), std=1e-3)
    nn.init.zeros_(layer.get_parameter("bias"))


def sampled(features: Tensor, place: Tensor) -> Tensor:
    """Return features (B, C, h, w) between cells, 0 outside; place: (B, 2, n, w), columns and rows -> (B, C, n, w)."""
    height, width = features.shape[-2:]
    size = torch.tensor([width - 1, height - 1], dtype=place.dtype, device=place.device).clamp(min=1)
    grid = 2 * place.permute(0, 2, 3, 1) / size - 1
    return F.grid_sample(features, grid, align_corners=True)


def upsampled(maps: Tensor, factor: int, size: Sequence[int] | None = None) -> Tensor:
    """Return maps (B, C, h, w) at `factor` times the size, where cell k of the old grid is cell factor k.

    Args:
        maps: The maps; beyond the last cells, they stay as there.
        factor: How many times larger the grid is.
        size: Height and width of what is returned, up to factor h and factor w; None for these.
    """
    height, width = (factor * side for side in maps.shape[-2:])
    larger = F.pad(maps, (0, 1, 0, 1), mode="replicate")
    larger = F.interpolate(larger, (height + 1, width + 1), mode="bilinear", align_corners=True)
    height, width = (height, width) if size is None else size
    return larger[..., :height, :width]


def in_float32(part: Callable[..., Tensor], *maps: Tensor) -> Tensor:
    """Call a part of a network without autocast: in bfloat16, a disparity of 100 px is rounded to half a pixel."""
    with torch.autocast(maps[0].device.type, enabled=False):
        return part(*(x.float() for x in maps))
