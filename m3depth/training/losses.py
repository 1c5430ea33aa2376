"""Training losses (paper, Sec. V-A): L = lambda_d L_d + lambda_n L_n + lambda_c L_c, and two decisions.

L_d is a Huber loss on disparity in pixels, plus a share relative to the true disparity, which is the relative error of
depth. (Depth from disparity is hyperbolic: one unit of depth / 15 m would be 1 px at 15 m and 320 px at 0.5 m.) L_n is
a Huber loss on the difference of unit vectors. L_c compares gradients of disparity, px per px. In these units the three
terms of a half-trained network are of similar size under the paper's lambdas 2, 1, 3.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor

from m3depth.network.geometry import pixel_rays, scale_camera, sobel, unit
from m3depth.network.output import StereoOutput
from m3depth.training.loss_config import LossConfig


class Target(NamedTuple):
    """Ground truth of a batch.

    Attributes:
        disparity: (B, 1, H, W) [px]; 0 on sky and where it is unknown.
        normal: (B, 3, H, W), unit length; 0 where it is unknown.
        label: (B, 1, H, W) bool, the pixels that are trained.
        sky: (B, 1, H, W) bool.
        rock: (B, 1, H, W) bool.
        camera: (B, 4) fx, fy, cx, cy [px].
    """

    disparity: Tensor
    normal: Tensor
    label: Tensor
    sky: Tensor
    rock: Tensor
    camera: Tensor

    @property
    def known(self) -> Tensor:
        """(B, 1, H, W) bool, the pixels whose disparity is known, trained or not; maps of lidars, for example, have
        gaps.
        """
        return (self.disparity > 0) | self.sky


def huber(error: Tensor, delta: float) -> Tensor:
    """Return the Huber norm over delta: quadratic up to delta, then |error| - delta / 2 (slope 1 for any delta)."""
    return F.smooth_l1_loss(error, torch.zeros_like(error), beta=delta, reduction="none")


def weighted_mean(values: Tensor, weight: Tensor) -> Tensor:
    """Return the mean of values under a weight of the same shape; 0 where all weights are 0."""
    # A product would let the NaN of a masked pixel through.
    return torch.where(weight > 0, values * weight, torch.zeros_like(values)).sum() / weight.sum().clamp(min=1e-6)


def disparity_range(disparity: Tensor, known: Tensor | None = None) -> Tensor:
    """Return the largest minus the smallest disparity in each 3 x 3 window. Level ground has B / h, half a pixel.

    Args:
        disparity: (B, 1, H, W) [px].
        known: (B, 1, H, W) bool, the pixels that count; None for all.

    Returns:
        (B, 1, H, W) [px]; 0 where a window holds no such pixel.
    """
    if known is None:
        high, low = disparity, -disparity
    else:
        high, low = (x.masked_fill(~known, -torch.inf) for x in (disparity, -disparity))
    return (F.max_pool2d(high, 3, 1, 1) + F.max_pool2d(low, 3, 1, 1)).clamp(min=0)


def disparity_edges(disparity: Tensor, known: Tensor | None = None, threshold: float = 1.0) -> Tensor:
    """Mark pixels whose 3 x 3 window spans more than `threshold` px of disparity: (B, 1, H, W) bool.

    Args:
        disparity: (B, 1, H, W) [px].
        known: The pixels that are compared, see disparity_range; an edge in a gap of them is missed.
        threshold: [px].
    """
    return disparity_range(disparity, known) > threshold


def consistency_residual(disparity: Tensor, normal: Tensor, camera: Tensor) -> tuple[Tensor, Tensor]:
    """Return the difference between a disparity map's Sobel gradient and the gradient that the normals demand.

    The paper has dZ/du = -Z n_x / (f_x (n . r)), r = ((u - cx) / fx, (v - cy) / fy, 1). Here it is multiplied through
    by n_z, so that n_z = 0 is not singular, and written for f B / Z: dd/du = d n_x / (f_x (n . r)). Disparity is affine
    on a plane, so the Sobel gradient is exact there, and it does not grow with range as that of Z does.

    Args:
        disparity: (B, 1, H, W) [px].
        normal: (B, 3, H, W), unit length.
        camera: (B, 4).

    Returns:
        (B, 2, H, W) residuals [px / px].
        (B, 1, H, W) bool, False where the surface is seen at a grazing angle (|n . r| / |r| under 0.05: level ground at
        24 m from a height of 1.2 m) or the Sobel window leaves the image.
    """
    rays = pixel_rays(camera, disparity.shape[-2], disparity.shape[-1])
    facing = -(normal * rays).sum(1, keepdim=True)  # -(n . r), positive towards the camera
    not_grazing = facing > 0.05 * rays.square().sum(1, keepdim=True).sqrt()
    inside = torch.zeros_like(not_grazing)
    inside[..., 1:-1, 1:-1] = True
    demanded = -disparity * normal[:, :2] / camera[:, :2, None, None] / torch.where(not_grazing, facing, 1.0)
    return demanded - sobel(disparity), not_grazing & inside


def consistency_loss(disparity: Tensor, normal: Tensor, camera: Tensor, mask: Tensor) -> Tensor:
    """Return the Huber norm of consistency_residual over mask (paper, Eq. 16).

    Args:
        disparity, normal, camera: See consistency_residual.
        mask: (B, 1, H, W) bool, which should leave out invalid pixels and depth edges; grazing ones are left out here.
    """
    residual, usable = consistency_residual(disparity, normal, camera)
    # 0.05 px / px is a fifth of the slope of level ground. A step that the true normals do not explain costs linearly.
    return weighted_mean(huber(residual, 0.05).sum(1, keepdim=True), (mask & usable).to(residual))


def reduce_target(target: Target, factor: int, weight: Tensor) -> tuple[Target, Tensor]:
    """Reduce ground truth and pixel weight to the grid with one cell for factor x factor pixels (factor 1, or even).

    The cell's centre lies between its four middle pixels. Its value is the mean of those that are known. The cell is
    not trained if one of them is known but not trained, or if they straddle an edge. Where only some are known, the
    value belongs to a point up to half a pixel beside the centre. The camera stays that of the full grid.

    Args:
        target: Ground truth; H and W are multiples of factor.
        factor: Side of a cell [px].
        weight: (B, 1, H, W) weight of the pixels.

    Returns:
        The target and the weight on the grid of H / factor x W / factor.
    """
    if factor == 1:
        return target, weight
    first = factor // 2 - 1

    def middle(x: Tensor) -> Tensor:
        return torch.stack([x[..., first + i :: factor, first + j :: factor] for i in (0, 1) for j in (0, 1)])

    def alike(x: Tensor) -> Tensor:
        """Mark cells with at least one known pixel, all of whose known pixels are in x."""
        return (middle(x) | ~known).all(0) & middle(x & target.known).any(0)

    disparity, known = middle(target.disparity), middle(target.known)
    span = disparity.masked_fill(~known, -torch.inf).amax(0) - disparity.masked_fill(~known, torch.inf).amin(0)
    mean = (disparity * known).sum(0) / known.sum(0).clamp(min=1)
    normal = unit(middle(target.normal).sum(0))
    reduced = Target(
        mean, normal, alike(target.label) & (span < 1.0), alike(target.sky), middle(target.rock).any(0), target.camera
    )
    return reduced, middle(weight).amax(0)


def disparity_loss(disparity: Tensor, target: Target, weight: Tensor, config: LossConfig) -> Tensor:
    """Return L_d on one grid: labelled pixels by their weight, sky pixels pulled to zero.

    Args:
        disparity, weight: (B, 1, h, w), the disparity in pixels of the full image.
        target: On the same grid.
        config: Weights.
    """
    error = disparity - target.disparity
    scale = 1 + config.relative / target.disparity.clamp(min=1.0)
    loss = weighted_mean(huber(error, 0.5) * scale, weight * target.label)
    if config.sky_disparity:
        loss = loss + config.sky_disparity * weighted_mean(huber(error, 0.5), target.sky.to(error))
    return loss


def normal_loss(normal: Tensor, target: Target, weight: Tensor) -> Tensor:
    """Return L_n on one grid: the Huber norm of the difference of unit vectors (its knee at 0.1 is 6 degrees).

    Pixels without a true normal (length 0, in datasets that have none) are left out.

    Args:
        normal: (B, 3, h, w), unit length.
        target: On the same grid.
        weight: (B, 1, h, w).
    """
    error = ((normal - target.normal).square().sum(1, keepdim=True) + 1e-8).sqrt()
    known = target.normal.square().sum(1, keepdim=True) > 0.25
    return weighted_mean(huber(error, 0.1), weight * (target.label & known))


def _cell(target: Target, maps: Tensor) -> int:
    """Return the side of a cell of maps on a coarser grid [px]."""
    return target.disparity.shape[-1] // maps.shape[-1]


def total_loss(output: StereoOutput, target: Target, config: LossConfig) -> tuple[Tensor, dict[str, Tensor]]:
    """Return the whole training loss, and its terms before weighting, detached, by name.

    Another term is an entry of `terms` and a weight of the same name in LossConfig.

    Args:
        output: Of the network, for images whose size is a multiple of 8.
        target: Their ground truth.
        config: Weights of the terms.
    """
    edges = disparity_edges(target.disparity, target.known)
    weight = torch.ones_like(target.disparity)
    weight = torch.where(edges, config.edge, weight)
    weight = torch.where(target.rock, config.rock, weight)
    terms = {
        "disparity": disparity_loss(output.disparity, target, weight, config),
        "normal": normal_loss(output.normal, target, weight),
    }
    if config.consistency:
        smooth = target.label & ~edges
        terms["consistency"] = consistency_loss(output.disparity, output.normal, target.camera, smooth)
    quarter, quarter_weight = reduce_target(target, 4, weight)
    coarser = [
        (config.decay ** (age + 1), *maps, quarter, quarter_weight) for age, maps in enumerate(output.steps[::-1])
    ]
    if output.initial is not None:  # at 1/8, or on the grid of the output head
        coarse, coarse_weight = reduce_target(target, _cell(target, output.initial[0]), weight)
        coarser.append((config.initial, *output.initial, coarse, coarse_weight))
    for share, disparity, normal, truth, coarser_weight in coarser:
        terms["disparity"] = terms["disparity"] + share * disparity_loss(disparity, truth, coarser_weight, config)
        terms["normal"] = terms["normal"] + share * normal_loss(normal, truth, coarser_weight)
        if config.consistency and config.consistent_steps:
            cell = _cell(target, disparity)
            smooth = truth.label & ~disparity_edges(truth.disparity, truth.known, float(cell))
            camera = scale_camera(target.camera, cell)
            difference = consistency_loss(disparity / cell, normal, camera, smooth)
            terms["consistency"] = terms["consistency"] + config.consistent_steps * share * difference

    known = target.label | target.sky
    correct = target.label & ((output.disparity.detach() - target.disparity).abs() < 1)
    terms["confidence"] = weighted_mean(
        F.binary_cross_entropy_with_logits(output.confidence, correct.to(weight), reduction="none"), known.to(weight)
    )
    terms["sky"] = weighted_mean(
        F.binary_cross_entropy_with_logits(output.sky, target.sky.to(weight), reduction="none"), known * weight
    )
    total = sum((getattr(config, name) * value for name, value in terms.items()), torch.zeros(()).to(weight))
    return total, {name: value.detach() for name, value in terms.items()}
