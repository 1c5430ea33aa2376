"""The paper's "Fusion": normals from an image and a depth map, whose features are joined at every resolution.

Zeng, Tong, Huang, Yan, Sun, Chen and Wang: "Deep Surface Normal Estimation with Hierarchical RGB-D Fusion", CVPR 2019,
arXiv:1904.03405; the sizes are those of its released model.

The image passes through an encoder down to 1/16, the depth through one down to 1/8. The decoder of the depth hands its
features to that of the image, at 1/8, 1/4 and 1/2, weighed by a confidence map that is learned from depth and its gaps.
Max pooling remembers where its values came from, and the image's decoder puts them back there. At full size both
branches give normals, from which last layers make the result. The hybrid loss compares components at 1/1 and 1/2, and
angles at 1/4 and 1/8.

The released model sees the depth [m] of whole images. Here crops are trained, in which a pixel's place says nothing of
its direction, so that the depth branch sees the direction beside the logarithm of depth. The confidence map,
which is unbounded, starts near 1, so that it does not negate the features of the depth branch.
"""

from __future__ import annotations

from itertools import pairwise

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from m3depth.rivals.config import FusionConfig
from m3depth.rivals.layers import in_float32
from m3depth.rivals.normal_network import NormalInput, NormalNetwork, NormalOutput, TrainedNormals

SHARES = (1.0, 0.5, 0.25, 0.125)  # weights of the losses at 1/1, 1/2, 1/4 and 1/8
GEOMETRY = 3  # channels of the depth branch's input: logarithm of depth, and the direction of the pixel


def convolutions(inputs: int, outputs: int, count: int) -> nn.Sequential:
    """Return 3 x 3 convolutions, each with instance normalisation and ReLU."""
    parts: list[nn.Module] = []
    for number in range(count):
        parts += [
            nn.Conv2d(outputs if number else inputs, outputs, 3, padding=1),
            nn.InstanceNorm2d(outputs, affine=True), nn.ReLU(inplace=True),
        ]  # fmt: skip
    return nn.Sequential(*parts)


def last_layers(inputs: int, inner: int) -> nn.Sequential:
    """Return the two convolutions that end in normals."""
    return nn.Sequential(
        nn.Conv2d(inputs, inner, 3, padding=1), nn.ReLU(inplace=True), nn.Conv2d(inner, 3, 3, padding=1)
    )


class DepthBranch(nn.Module):
    """Encoder and decoder of the depth, which give features at 1/8, 1/4 and 1/2, and normals.

    Args:
        widths: Channels at 1/1, 1/2, 1/4 and 1/8.
    """

    def __init__(self, widths: tuple[int, ...]) -> None:
        super().__init__()
        self.first = convolutions(GEOMETRY, widths[0], 2)
        self.down = nn.ModuleList([convolutions(fine, coarse, 2) for fine, coarse in pairwise(widths)])
        # what a decoder makes at a scale has the width of the next finer one
        self.up = nn.ModuleList(
            [
                convolutions(widths[3], widths[2], 2),
                convolutions(2 * widths[2], widths[1], 2),
                convolutions(2 * widths[1], widths[0], 2),
            ]
        )
        self.last = last_layers(2 * widths[0], widths[0])

    def forward(self, x: Tensor) -> list[Tensor]:
        """Return features at 1/8, 1/4 and 1/2, and normals (B, 3, H, W), from the first layers' (B, C, H, W)."""
        levels = [x]
        for down in self.down:
            levels.append(down(F.max_pool2d(levels[-1], 2)))
        given = []
        x = levels.pop()
        for up in self.up:
            x = up(x)
            given.append(x)
            x = torch.cat([F.interpolate(x, scale_factor=2.0, mode="bilinear"), levels.pop()], 1)
        return [*given, self.last(x)]


class Fusion(NormalNetwork):
    """Fusion."""

    config: FusionConfig

    def __init__(self, config: FusionConfig) -> None:
        super().__init__(config)
        w, width = config.widths, config.confidence
        self.first = convolutions(3, w[0], 2)
        self.down = nn.ModuleList(
            [convolutions(w[0], w[1], 2), *(convolutions(w[n], w[n + 1], 3) for n in range(1, 4))]
        )
        self.depth = DepthBranch(w[:4])
        self.confidence = nn.Sequential(
            nn.Conv2d(GEOMETRY + 1, width, 3, padding=1), nn.InstanceNorm2d(width, affine=True), nn.LeakyReLU(),
            nn.Conv2d(width, width, 3, padding=1), nn.InstanceNorm2d(width, affine=True), nn.LeakyReLU(),
            nn.Conv2d(width, width, 1), nn.LeakyReLU(), nn.Conv2d(width, width, 1), nn.LeakyReLU(),
            nn.Conv2d(width, 1, 1),
        )  # fmt: skip
        nn.init.ones_(self.confidence[-1].get_parameter("bias"))
        self.coarsest = convolutions(w[4], w[3], 3)
        self.up = nn.ModuleList(
            [convolutions(2 * w[3], w[2], 3), convolutions(2 * w[2], w[1], 3), convolutions(2 * w[1], w[0], 2)]
        )
        self.join = nn.ModuleList([convolutions(2 * width, width, 2) for width in (w[2], w[1], w[0])])
        self.coarse = nn.ModuleList([nn.Conv2d(width, 3, 3, padding=1) for width in (w[2], w[1], w[0])])
        self.image = last_layers(2 * w[0], w[0])
        f = config.final
        self.final = nn.Sequential(convolutions(6, f[0], 2), convolutions(f[0], f[1], 2), last_layers(f[1], f[2]))

    def normals(self, inputs: NormalInput) -> NormalOutput:
        """Return the normals of a batch, those of all scales in training."""
        geometry = torch.cat([inputs.log_depth, inputs.rays[:, :2]], 1)
        confidence = in_float32(self.confidence, torch.cat([geometry, inputs.valid.to(geometry)], 1))
        *given, from_depth = self.call(self.depth, in_float32(self.depth.first, geometry))
        normal, coarse = self.call(self._decoded, inputs.left, given, from_depth, confidence)
        trained = [TrainedNormals(normal, 1, SHARES[0], "absolute")]
        for place, maps in enumerate(reversed(coarse)):
            trained.append(TrainedNormals(maps, 2 << place, SHARES[place + 1], "cosine" if place else "absolute"))
        return NormalOutput(inputs.disparity, normal, trained)

    def _decoded(
        self, left: Tensor, given: list[Tensor], from_depth: Tensor, confidence: Tensor
    ) -> tuple[Tensor, list[Tensor]]:
        """Return the normals (B, 3, H, W), and those at 1/8, 1/4 and 1/2.

        Args:
            left: (B, 3, H, W).
            given: Features of the depth at 1/8, 1/4 and 1/2.
            from_depth: (B, 3, H, W) normals of the depth branch.
            confidence: (B, 1, H, W) of the depth.
        """
        features, places = [self.first(left)], []
        for down in self.down:
            x, place = F.max_pool2d(features[-1], 2, return_indices=True)
            places.append(place)
            features.append(down(x))
        weights = [confidence]  # at 1/1, 1/2, 1/4 and 1/8
        for _ in given:
            weights.append(F.max_pool2d(weights[-1], 2))
        x = self.coarsest(features.pop())
        coarse = []
        for step, up in enumerate(self.up):
            x = up(torch.cat([F.max_unpool2d(x, places.pop(), [2, 2]), features.pop()], 1))
            x = self.join[step](torch.cat([x, given[step] * weights.pop()], 1))
            coarse.append(self.coarse[step](x))
        from_image = self.image(torch.cat([F.max_unpool2d(x, places.pop(), [2, 2]), features.pop()], 1))
        return self.final(torch.cat([from_image, from_depth * confidence], 1)), coarse
