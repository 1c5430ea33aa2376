"""The last correction, at half the resolution: match once more with pixels twice as fine, and see the image itself.

The recurrent steps stand at a quarter of the resolution, where a facet of a rock is a cell or two and a tenth of a
pixel of disparity a fortieth of a cell. This part is not in the paper.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from m3depth.network.cost_volume import matchable
from m3depth.network.geometry import normals_from_disparity, relief, scale_camera, unit
from m3depth.network.refinement import DISPARITY_SCALE

CELL = 2  # [px] of the grid that the correction is computed on
MATCHED = 16  # features that are compared
MAPS = 6  # disparity, normal, confidence, sky


def warp_right(right: Tensor, disparity: Tensor) -> Tensor:
    """What the right image shows where the left one's pixels are said to lie; 0 outside of it.

    right: (B, C, H, W). disparity: (B, 1, H, W) in cells of this grid. Linear along the row.
    """
    width = right.shape[-1]
    column = torch.arange(width, dtype=torch.float32, device=right.device)
    position = (column - disparity.float()).clamp(-1, width)  # (B, 1, H, W)
    start = position.floor()
    fraction = position - start
    padded = F.pad(right, (1, 2))
    index = (start.long() + 1).clamp(0, width + 1)  # of a NaN too, which stays one
    near, far = (padded.gather(3, i.expand(-1, right.shape[1], -1, -1)) for i in (index, index + 1))
    return near + fraction * (far - near)


class FineCorrection(nn.Module):
    """Corrects the upsampled maps by what is seen at half the resolution; starts as no correction.

    features: channels at 1/2. hidden: channels of the recurrent state at 1/4. width: of the convolutions. radius:
    compared with a pixel is what the right image shows at its own disparity and at those of so many pixels to either
    side in the row, each by its own disparity.
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
        """left, right: (B, C, H / 2, W / 2) features. hidden: (B, hidden, H / 4, W / 4). camera: (B, 4), full size.

        maps: (B, 6, H, W) disparity [px], normal, confidence and sky logits. Returns (B, 6, H, W), to be added.
        """
        given = F.avg_pool2d(maps.detach(), CELL)
        disparity, normal, logits = given[:, :1], unit(given[:, 1:4]), given[:, 4:]
        match_left, match_right = matchable(self.match(torch.cat([left, right])).float().contiguous()).chunk(2)
        warped = F.pad(warp_right(match_right, disparity / CELL), (self.radius, self.radius))
        width = match_left.shape[-1]
        scores = [(match_left * warped[..., k : k + width]).mean(1, True) for k in range(2 * self.radius + 1)]
        implied = normals_from_disparity(disparity, scale_camera(camera, CELL))
        seen = [*scores, disparity / DISPARITY_SCALE, relief(disparity), normal, implied, logits.clamp(-8, 8) / 4]
        x = self.first(torch.cat([left, torch.cat(seen, 1).to(left.dtype)], 1))
        x = self.trunk(x + F.pixel_shuffle(self.state(hidden), CELL))
        return F.pixel_shuffle(self.last(x).float(), CELL)
