"""GeoNet, on M3Depth's depth: normals of the image and of the depth correct each other, and the normals the depth.

Qi, Liao, Liu, Urtasun and Jia: "GeoNet: Geometric Neural Network for Joint Depth and Surface Normal Estimation", CVPR
2018; the sizes are those of its released model. Its stream that guesses depth from one image is left out, since there
is the depth of a pair, and so is the refinement of edges, which belongs to GeoNet++.

A VGG network gives first normals. From depth to normal: planes are fitted to the points of a window, those whose first
normals are alike, and a small network adds a residual. Another one joins both normals. From normal to depth: each pixel
of the window says where its own plane meets the ray of the middle one, and a mean, weighed by how alike the normals
are, is the refined depth. From it, the given depth and the image, a last network corrects the given depth by a factor.
(The released one gives the depth itself, in metres of a room, and its loss is the error in metres; here it is that of
the logarithm.) The two steps of geometry have no parameters and hand no gradient on, as in the released training. There
the network of the residual starts from weights that were trained before; here it starts as almost no correction.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from m3depth.network.backbone import conv_block
from m3depth.network.geometry import MIN_DISPARITY, facing_normals, normals_from_disparity, unit
from m3depth.rivals.config import GeoNetConfig
from m3depth.rivals.layers import in_float32, start_as_he, start_small, upsampled
from m3depth.rivals.normal_network import NormalInput, NormalNetwork, NormalOutput, TrainedNormals

APART = 4  # distance between the pixels of a window [px]
ALIKE = 0.95  # least cosine of the angle between normals of one plane
SHARP = 10.0  # factor of normals, of the global feature and of differences of depth that networks get
REACH = 12  # dilation of the layer that sees most of the image
LEAST_DETERMINANT = APART**4 / 2  # half of that of three pixels of a window, which determine a plane
GRAZING = 1e-3  # least product of a normal and of a ray of z = 1 that meets its plane
LARGEST_CHANGE = 1.5  # factor of depth, by the normals and by the last network


class FirstNormals(nn.Module):
    """Normals of the image alone: VGG-16 down to 1/8, a layer of long reach, and the mean over the image beside it."""

    def __init__(self, widths: tuple[int, ...], wide: int) -> None:
        super().__init__()
        stages = []
        inputs = 3
        for number, (width, count) in enumerate(zip(widths, (2, 2, 3, 3, 3), strict=True)):
            dilation = 2 if number == 4 else 1
            convolutions = [conv_block(inputs if n == 0 else width, width, dilation=dilation) for n in range(count)]
            pool = nn.MaxPool2d(3, 2 if number < 3 else 1, padding=1)
            stages.append(nn.Sequential(*convolutions, pool))
            inputs = width
        self.stages = nn.Sequential(
            *stages, nn.AvgPool2d(3, 1, padding=1), conv_block(inputs, wide, dilation=REACH), conv_block(wide, wide, 1)
        )
        self.last = nn.Conv2d(2 * wide, 3, 1)

    def forward(self, left: Tensor) -> Tensor:
        """(B, 3, H, W) -> (B, 3, H, W), unit length."""
        x = self.stages(left)
        whole = SHARP * unit(x.mean((2, 3), keepdim=True))
        normal = self.last(torch.cat([x, whole.expand_as(x)], 1)).float()
        return unit(upsampled(normal, 8, left.shape[-2:]))


def convolution(inputs: int, outputs: int, kernel: int = 3, dilation: int = 1) -> nn.Sequential:
    """Return a convolution and ReLU, without normalisation: its statistics would differ between crops and images."""
    padding = dilation * (kernel // 2)
    return nn.Sequential(nn.Conv2d(inputs, outputs, kernel, 1, padding, dilation), nn.ReLU(inplace=True))


class Residual(nn.Module):
    """What is to be added to the normals of the depth, from them, at half of their size."""

    def __init__(self, widths: tuple[int, ...]) -> None:
        super().__init__()
        parts: list[nn.Module] = []
        inputs = 3
        for number, (width, count) in enumerate(zip(widths[:3], (2, 2, 3), strict=True)):
            parts += [convolution(inputs if n == 0 else width, width) for n in range(count)]
            parts += [nn.MaxPool2d(3, 2, padding=1)] if number == 0 else []
            inputs = width
        last = nn.Conv2d(widths[3], 3, 3, padding=1)
        self.layers = nn.Sequential(*parts, convolution(inputs, widths[3], 1), last)
        start_as_he(self.layers)
        start_small(last)

    def forward(self, normal: Tensor) -> Tensor:
        """(B, 3, H, W) -> (B, 3, H, W)."""
        change = self.layers(SHARP * normal).float()
        return upsampled(change, 2, normal.shape[-2:])


def ensemble(inputs: int, width: int, outputs: int) -> nn.Sequential:
    """Return the network that joins two estimates and the image: three dilated convolutions, and four plain ones."""
    dilated = [convolution(width if n else inputs, width, dilation=2) for n in range(3)]
    plain = [convolution(width, width) for _ in range(3)]
    layers = nn.Sequential(*dilated, *plain, nn.Conv2d(width, outputs, 3, padding=1))
    start_as_he(layers)
    return layers


def windows(maps: Tensor, side: int, apart: int = APART) -> Iterator[tuple[int, int, Tensor]]:
    """Yield the offsets of a window across and down [px], each with maps (B, C, H, W) from there; 0 outside the image.

    Args:
        maps: The maps.
        side: Pixels along the side of the window.
        apart: Distance between them [px].
    """
    height, width = maps.shape[-2:]
    reach = side // 2 * apart
    padded = F.pad(maps, (reach,) * 4)
    for down in range(-reach, reach + 1, apart):
        for across in range(-reach, reach + 1, apart):
            top, left = reach + down, reach + across
            yield across, down, padded[..., top : top + height, left : left + width]


def planes_of_depth(inputs: NormalInput, normal: Tensor, side: int) -> Tensor:
    """Return the normals of planes fitted to the points of windows, by least squares of a . X = 1 (Eq. 2 to 4).

    Args:
        inputs: Holds the disparity and the camera.
        normal: (B, 3, H, W) first normals; points count whose normals are like that of the middle.
        side: Pixels along the side of a window.

    Returns:
        (B, 3, H, W), unit length, facing the camera; where the points give no plane, the normal of the disparity's
        slopes.
    """
    # With the middle's depth as the unit, a point is X = z (r + (x / fx, y / fy, 0)), r the ray of the middle and x, y
    # the offset from it. So a . X = z (x a_1 / fx + y a_2 / fy + a . r), whose three unknowns have no large products.
    moments = inputs.disparity.new_zeros(9, *inputs.disparity.shape)
    for x, y, moved in windows(torch.cat([inputs.disparity, normal, inputs.valid.to(normal)], 1), side):
        other, valid = moved[:, 1:4], moved[:, 4:]
        weight = valid * ((other * normal).sum(1, keepdim=True) > ALIKE)
        z = inputs.disparity / moved[:, :1].clamp(min=MIN_DISPARITY)
        first = weight * z
        second = first * z
        for place, (weighted, factor) in enumerate(
            [(second, x * x), (second, x * y), (second, x), (second, y * y), (second, y), (second, 1),
             (first, x), (first, y), (first, 1)]
        ):  # fmt: skip
            moments[place].add_(weighted, alpha=factor)
    xx, xy, x1, yy, y1, one, right_x, right_y, right_1 = moments
    xx_, xy_, x1_ = yy * one - y1 * y1, x1 * y1 - xy * one, xy * y1 - x1 * yy  # the adjugate, which is symmetric
    yy_, y1_, one_ = xx * one - x1 * x1, xy * x1 - xx * y1, xx * yy - xy * xy
    determinant = xx * xx_ + xy * xy_ + x1 * x1_
    across, down, along = (  # a_1 / fx, a_2 / fy and a . r, times the determinant
        right_x * p + right_y * q + right_1 * r for p, q, r in ((xx_, xy_, x1_), (xy_, yy_, y1_), (x1_, y1_, one_))
    )
    slopes = torch.cat([across, down], 1) * inputs.camera[:, :2, None, None]
    plane = torch.cat([slopes, along - (slopes * inputs.rays[:, :2]).sum(1, keepdim=True)], 1)
    determined = determinant > LEAST_DETERMINANT
    sloped = normals_from_disparity(inputs.disparity, inputs.camera)
    return facing_normals(torch.where(determined, -unit(plane), sloped), inputs.rays)  # a points away from the camera


def disparity_of_planes(inputs: NormalInput, normal: Tensor, side: int) -> Tensor:
    """Return the disparity (B, 1, H, W) [px] at which the planes of a window's pixels meet the ray of the middle one.

    A pixel j with ray r_j, depth Z_j and normal n_j has the depth Z_j (n_j . r_j) / (n_j . r) on the middle one's ray r
    (Eq. 7 and 8).

    Args:
        inputs: Holds the disparity and the rays.
        normal: (B, 3, H, W), unit length, facing the camera.
        side: Pixels along the side of a window.
    """
    facing = -(normal * inputs.rays).sum(1, keepdim=True)
    total, weights = torch.zeros_like(facing), torch.zeros_like(facing)
    for _, _, moved in windows(torch.cat([inputs.disparity, facing, normal, inputs.valid.to(normal)], 1), side):
        other, valid = moved[:, 2:5], moved[:, 5:]
        alike = (other * normal).sum(1, keepdim=True)
        meets = -(other * inputs.rays).sum(1, keepdim=True)
        weight = valid * torch.where((alike > ALIKE) & (meets > GRAZING), alike, torch.zeros_like(alike))
        z = inputs.disparity / moved[:, :1].clamp(min=MIN_DISPARITY)
        total += weight * z * moved[:, 1:2] / meets.clamp(min=GRAZING)
        weights += weight
    farther = torch.where(weights > 0, total / weights.clamp(min=1e-6), torch.ones_like(total))
    return inputs.disparity / farther.clamp(1 / LARGEST_CHANGE, LARGEST_CHANGE)


class GeoNet(NormalNetwork):
    """GeoNet."""

    config: GeoNetConfig

    def __init__(self, config: GeoNetConfig) -> None:
        super().__init__(config)
        self.first = FirstNormals(config.widths, config.wide)
        self.residual = Residual(config.residual)
        self.joined_normals = ensemble(3 + 3 + 3, config.ensemble, 3)
        self.joined_depths = ensemble(1 + 1 + 3, config.ensemble, 1)
        start_small(self.joined_depths[-1])

    def normals(self, inputs: NormalInput) -> NormalOutput:
        """Return the normals and the corrected disparity of a batch."""
        side = self.config.neighbours
        first = self.call(self.first, inputs.left)
        with torch.no_grad(), torch.autocast(inputs.left.device.type, enabled=False):
            start = facing_normals(first, inputs.rays)
            fitted = planes_of_depth(inputs, start, side)
            refined = disparity_of_planes(inputs, start, side).clamp(min=MIN_DISPARITY)
        corrected = unit(fitted + self.call(self.residual, fitted))
        normal = self.call(self.joined_normals, torch.cat([first, corrected, inputs.left], 1)).float()
        farther = SHARP * (inputs.disparity / refined).log()
        depths = torch.cat([inputs.log_depth, farther, inputs.left], 1)
        change = in_float32(partial(self.call, self.joined_depths), depths)
        disparity = inputs.disparity / change.exp().clamp(1 / LARGEST_CHANGE, LARGEST_CHANGE)
        trained = [TrainedNormals(maps, 1, 1.0, "absolute") for maps in (normal, first)]
        return NormalOutput(disparity, normal, trained, trained_disparity=True)
