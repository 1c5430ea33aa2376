"""The last correction, at half the resolution: match once more, with pixels twice as fine.

The recurrent steps work at a quarter of the resolution, where a facet of a rock is a cell or two, and a tenth of a
pixel of disparity is a fortieth of a cell. This part is not in the paper.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from m3depth.network.cost_volume import centred, pair_mean
from m3depth.network.geometry import normals_from_disparity, relief, scale_camera, unit
from m3depth.network.refinement import DISPARITY_SCALE
from m3depth.network.row_bands import by_rows

CELL = 2  # side of a cell of this part's grid [px of the image]
MATCHED = 16  # feature channels that are compared
MAPS = 6  # channels of the maps: disparity, normal (3), confidence, sky


def warp_right(right: Tensor, disparity: Tensor) -> Tensor:
    """Sample the right image where the disparity says that the left image's pixels lie; 0 outside of it.

    Args:
        right: (B, C, H, W).
        disparity: (B, 1, H, W) in cells of this grid.

    Returns:
        (B, C, H, W), interpolated linearly along the row.
    """
    width = right.shape[-1]
    column = torch.arange(width, dtype=torch.float32, device=right.device)
    position = (column - disparity.float()).clamp(-1, width)  # (B, 1, H, W)
    start = position.floor()
    fraction = position - start
    padded = F.pad(right, (1, 2))
    index = (start.long() + 1).clamp(0, width + 1)  # a NaN gets an index in range, and stays NaN
    near, far = (padded.gather(3, i.expand(-1, right.shape[1], -1, -1)) for i in (index, index + 1))
    return near + fraction * (far - near)


class FineCorrection(nn.Module):
    """Corrects the upsampled maps with features at half the resolution. It starts as no correction.

    A left pixel is compared with what the right image shows at that pixel's disparity, and at the matches of `radius`
    neighbours to either side in its row, each found by the neighbour's own disparity.

    Args:
        features: Channels at 1/2.
        hidden: Channels of the recurrent state at 1/4.
        width: Channels of the convolutions.
        radius: Neighbours to either side, in pixels of this grid.
    """

    def __init__(self, features: int, hidden: int, width: int, radius: int = 2) -> None:
        super().__init__()
        self.radius = radius
        self.match = nn.Conv2d(features, MATCHED, 3, padding=1)
        self.state = nn.Conv2d(hidden, 4 * width, 1)
        inputs = features + (2 * radius + 1) + 2 + 3 + 3 + 2
        self.first = nn.Conv2d(inputs, width, 3, padding=1)
        self.trunk = nn.Sequential(
            nn.ReLU(inplace=True),
            nn.Conv2d(width, width, 3, padding=2, dilation=2),
            nn.ReLU(inplace=True),
            nn.Conv2d(width, width, 3, padding=1),
            nn.ReLU(inplace=True),
        )
        self.last = nn.Conv2d(width, CELL * CELL * MAPS, 3, padding=1)
        nn.init.zeros_(self.last.weight)
        nn.init.zeros_(self.last.get_parameter("bias"))

    def forward(self, left: Tensor, right: Tensor, hidden: Tensor, maps: Tensor, camera: Tensor) -> Tensor:
        """Compute the correction.

        Args:
            left, right: (B, C, H / 2, W / 2) features.
            hidden: (B, hidden, H / 4, W / 4).
            maps: (B, 6, H, W): disparity [px], normal, logits of confidence and sky.
            camera: (B, 4) of the full-size image.

        Returns:
            (B, 6, H, W), to be added to the maps.
        """
        halved = F.avg_pool2d(maps.detach(), CELL)  # (B, 6, H / 2, W / 2)
        disparity, normal, logits = halved[:, :1], unit(halved[:, 1:4]), halved[:, 4:]
        compared = self.match(torch.cat([left, right])).float().contiguous()
        mean = pair_mean(compared)
        scores = by_rows(lambda pair, d: self._scores(centred(pair, mean), d), compared, disparity)
        implied = normals_from_disparity(disparity, scale_camera(camera, CELL))
        inputs = [scores, disparity / DISPARITY_SCALE, relief(disparity), normal, implied, logits.clamp(-8, 8) / 4]
        x = self.first(torch.cat([left, torch.cat(inputs, 1).to(left.dtype)], 1))  # (B, width, H / 2, W / 2)
        x = self.trunk(x + F.pixel_shuffle(self.state(hidden), CELL))
        return F.pixel_shuffle(self.last(x).float(), CELL)  # (B, 6, H, W)

    def _scores(self, pair: Tensor, disparity: Tensor) -> Tensor:
        """Compare features (2 B, MATCHED, h, W) at disparities (B, 1, h, W) [px]: (B, 2 radius + 1, h, W)."""
        left, right = pair.chunk(2)
        warped = F.pad(warp_right(right, disparity / CELL), (self.radius, self.radius))
        width = left.shape[-1]
        return torch.cat([(left * warped[..., k : k + width]).mean(1, True) for k in range(2 * self.radius + 1)], 1)
