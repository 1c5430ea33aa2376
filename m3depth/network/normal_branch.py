"""SNNet: surface normals from the cost volume (paper, Table II)."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from m3depth.network.backbone import conv_block, group_norm
from m3depth.network.config import M3DepthConfig
from m3depth.network.geometry import resize, unit


def hypothesis_points(rays: Tensor, hypotheses: int) -> Tensor:
    """Return the camera-frame X, Y, Z of each pixel at each disparity hypothesis, scaled into [-1, 1], without
    gradient.

    Slice i stands for disparity i steps, so Z is proportional to 1 / i; slice 0 (infinitely far) is set to half a step.

    Args:
        rays: (B, 3, H, W) with z = 1.
        hypotheses: D, the number of slices.

    Returns:
        (B, 3, D, H, W); Z is 1 at half a step, and less if the camera sees more than 45 deg to a side.
    """
    index = torch.arange(hypotheses, dtype=rays.dtype, device=rays.device).clamp(min=0.5)
    z = (0.5 / index)[:, None, None]
    widest = rays.abs().amax((1, 2, 3), keepdim=True)  # 1 or more, for z = 1
    return ((rays / widest)[:, :, None] * z).detach()


class SNNet(nn.Module):
    """Three 3-D convolutions of stride 2 in depth, one 2-D network for each of the D / 8 slices, sum, unit length:

    n = sum_i SNNet(S_i) / |sum_i SNNet(S_i)| (paper, Eq. 9).

    Every slice gets config.normal_context channels of left features (none in the paper). The 2-D network has
    config.slice_layers convolutions (two in the paper); with config.slice_dilated, all but the last are dilated by 2,
    4, ... The last layer is linear: with the ReLU of the paper's table no component could be negative.
    """

    def __init__(self, config: M3DepthConfig) -> None:
        super().__init__()
        context, widths = config.normal_context, config.normal_widths
        self.context = nn.Conv2d(config.channels[2], context, 1) if context else None
        inputs = (config.groups + 3 + context, *widths[:2])
        self.volume = nn.Sequential(
            *(
                nn.Sequential(
                    nn.Conv3d(i, o, 3, stride=(2, 1, 1), padding=1, bias=False), group_norm(o), nn.ReLU(inplace=True)
                )
                for i, o in zip(inputs, widths)
            )
        )
        self.slice = nn.Sequential(
            *(
                conv_block(widths[2], widths[2], dilation=2**i if config.slice_dilated else 1)
                for i in range(1, config.slice_layers)
            ),
            nn.Conv2d(widths[2], 3, 3, padding=1),
        )

    def forward(self, volume: Tensor, left: Tensor, rays: Tensor) -> Tensor:
        """Compute normals from the cost volume.

        Args:
            volume: (B, G, D, H, W).
            left: (B, C, h, w) left features on any grid.
            rays: (B, 3, H, W) of the volume's grid, z = 1.

        Returns:
            (B, 3, H, W) unit normals in the camera frame.
        """
        depth = volume.shape[2]
        parts = [volume, hypothesis_points(rays, depth).to(volume.dtype)]  # (B, G, D, H, W), (B, 3, D, H, W)
        if self.context is not None:
            context = resize(self.context(left), volume.shape[-2:])
            parts.append(context[:, :, None].expand(-1, -1, depth, -1, -1))
        x = self.volume(torch.cat(parts, 1))  # (B, C, D / 8, H, W)
        slices = depth // 8
        x = self.slice(x.transpose(1, 2).flatten(0, 1))  # (B D / 8, 3, H, W)
        total = x.unflatten(0, (-1, slices)).sum(1).float()  # (B, 3, H, W)
        return unit(total)
