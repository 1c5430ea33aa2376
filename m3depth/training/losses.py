"""Training losses (paper, Sec. V-A): L = lambda_d L_d + lambda_n L_n + lambda_c L_c, and two decisions.

L_d is a Huber loss on disparity in pixels, plus a share relative to the true disparity, which is the relative error of
depth. (Depth from disparity is hyperbolic: an error of 1 px is 900 times as large in depth at 15 m as at 0.5 m.) L_n is
a Huber loss on the difference of unit vectors. L_c compares gradients of disparity, px per px. In these units the three
terms of a half-trained network are of similar size under the paper's lambdas 2, 1, 3.

With LossConfig.depth, the three are the paper's: L_d and L_c are of depth over 15 m, the knee of each Huber norm is at
PAPER_KNEE, and pixels beyond 15 m have none.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import reduce
from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor

from m3depth.network.geometry import MIN_DISPARITY, pixel_rays, scale_camera, sobel
from m3depth.network.output import StereoOutput
from m3depth.network.refinement import CELL
from m3depth.rivals.output import TrainedOutput, Truth
from m3depth.training.batch import Target, disparity_edges, reduce_target
from m3depth.training.loss_config import LossConfig

FARTHEST_SCORED = 15.0  # [m] depth that counts as 1 in the paper's loss, and beyond which it has none
PAPER_KNEE = 1.0  # of the paper's Huber norms, which it does not give
DISPARITY_KNEE = 0.5  # [px]
NORMAL_KNEE = 0.1  # 6 degrees
LEAST_COSINE = 0.05  # -(n . r) / |r| of level ground at 24 m from a height of 1.2 m; under it, it is grazing
SLOPE_KNEE = 0.05  # [px / px] a fifth of the slope of level ground: a step that no normals explain costs linearly
# Mean weight of a batch's pixels from which on it counts in full. Without it, a few pixels, or the rover's own panels,
# had losses ten times those of other crops, and decided the direction of most steps.
LEAST_WEIGHT = 0.5


def huber(error: Tensor, delta: float) -> Tensor:
    """Return the Huber norm over delta: quadratic up to delta, then |error| - delta / 2 (slope 1 for any delta)."""
    return F.smooth_l1_loss(error, torch.zeros_like(error), beta=delta, reduction="none")


def weighted_mean(values: Tensor, weight: Tensor, least: float = 0.0) -> Tensor:
    """Return the mean of values under a weight of the same shape; 0 where all weights are 0.

    Args:
        values: Any shape.
        weight: 0 or more.
        least: Mean weight that the whole is given at least, so that the values count less if few of them have weight.
    """
    # A product would let the NaN of a masked pixel through.
    weighted = torch.where(weight > 0, values * weight, torch.zeros_like(values)).sum()
    return weighted / weight.sum().clamp(min=max(1e-6, least * weight.numel()))


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
        (B, 1, H, W) bool, False where the normal faces away from the camera, or says that the surface is seen at a
        grazing angle (-(n . r) / |r| under LEAST_COSINE), and where the Sobel window leaves the image.
    """
    growth, usable = _growth(normal, camera)
    return -disparity * growth - sobel(disparity), usable


def depth_consistency_residual(depth: Tensor, normal: Tensor, camera: Tensor) -> tuple[Tensor, Tensor]:
    """Return consistency_residual of a depth map, (B, 1, H, W) in any unit, as the paper has it.

    Depth is not affine on a plane: its Sobel gradient is right to second order. As in the paper, normals that face away
    count like their opposites.
    """
    growth, usable = _growth(normal, camera, both_sides=True)
    return depth * growth - sobel(depth), usable


def _growth(normal: Tensor, camera: Tensor, both_sides: bool = False) -> tuple[Tensor, Tensor]:
    """Return by which share of itself depth grows from pixel to pixel, (B, 2, H, W), and where this can be used.

    Args:
        normal: (B, 3, H, W), unit length.
        camera: (B, 4).
        both_sides: Whether it can be used where the normal faces away from the camera.
    """
    rays = pixel_rays(camera, normal.shape[-2], normal.shape[-1])
    facing = -(normal * rays).sum(1, keepdim=True)  # -(n . r), positive towards the camera
    not_grazing = (facing.abs() if both_sides else facing) > LEAST_COSINE * rays.square().sum(1, keepdim=True).sqrt()
    inside = torch.zeros_like(not_grazing)
    inside[..., 1:-1, 1:-1] = True
    return normal[:, :2] / camera[:, :2, None, None] / torch.where(not_grazing, facing, 1.0), not_grazing & inside


def consistency_loss(disparity: Tensor, normal: Tensor, camera: Tensor, mask: Tensor) -> Tensor:
    """Return the Huber norm of consistency_residual over mask (paper, Eq. 16).

    Args:
        disparity, normal, camera: See consistency_residual.
        mask: (B, 1, H, W) bool, which should leave out invalid pixels and depth edges; grazing ones are left out here.
    """
    return _norm_of_residual(*consistency_residual(disparity, normal, camera), SLOPE_KNEE, mask)


def _norm_of_residual(residual: Tensor, usable: Tensor, knee: float, mask: Tensor) -> Tensor:
    return weighted_mean(huber(residual, knee).sum(1, keepdim=True), (mask & usable).to(residual))


def disparity_loss(disparity: Tensor, target: Target, weight: Tensor, config: LossConfig) -> Tensor:
    """Return L_d on one grid: labelled pixels by their weight, sky pixels pulled to zero.

    Args:
        disparity, weight: (B, 1, h, w), the disparity in pixels of the full image.
        target: On the same grid.
        config: Weights.
    """
    if config.depth:
        return depth_loss(disparity, target, weight)
    error = disparity - target.disparity
    scale = 1 + config.relative / target.disparity.clamp(min=1.0)
    loss = weighted_mean(huber(error, DISPARITY_KNEE) * scale, weight * target.label, LEAST_WEIGHT)
    if config.sky_disparity:
        loss = loss + config.sky_disparity * weighted_mean(huber(error, DISPARITY_KNEE), target.sky.to(error))
    return loss


def depth_loss(disparity: Tensor, target: Target, weight: Tensor) -> Tensor:
    """Return L_d of the paper on one grid: the Huber norm of depth over FARTHEST_SCORED.

    Args:
        disparity, weight: (B, 1, h, w), the disparity in pixels of the full image.
        target: On the same grid.
    """
    error = scaled_depth(disparity, target) - _least_disparity(target) / target.disparity.clamp(min=MIN_DISPARITY)
    return weighted_mean(huber(error, PAPER_KNEE), weight * target.label)


def scaled_depth(disparity: Tensor, target: Target) -> Tensor:
    """Return depth over FARTHEST_SCORED, (B, 1, h, w), of a disparity on the grid of a target.

    Below a disparity of 1 px, depth grows without bound: it is the tangent there, so that its gradient stays finite.
    """
    held = disparity.clamp(min=1.0)
    return _least_disparity(target) * (1 / held + held - disparity)


def _least_disparity(target: Target) -> Tensor:
    """Return the disparity [px of the full image] at FARTHEST_SCORED, (B, 1, 1, 1)."""
    return (target.camera[:, 0] * target.baseline / FARTHEST_SCORED)[:, None, None, None]


def normal_loss(
    normal: Tensor, target: Target, weight: Tensor, knee: float = NORMAL_KNEE, least: float = LEAST_WEIGHT
) -> Tensor:
    """Return L_n on one grid: the Huber norm of the difference of unit vectors.

    Pixels without a true normal (length 0, in datasets that have none) are left out.

    Args:
        normal: (B, 3, h, w), unit length.
        target: On the same grid.
        weight: (B, 1, h, w).
        knee: Of the Huber norm.
        least: Least mean weight that the mean divides by; see weighted_mean.
    """
    error = ((normal - target.normal).square().sum(1, keepdim=True) + 1e-8).sqrt()
    valid = target.normal.square().sum(1, keepdim=True) > 0.25
    return weighted_mean(huber(error, knee), weight * (target.label & valid), least)


def total_loss(
    output: StereoOutput | TrainedOutput, target: Target, config: LossConfig
) -> tuple[Tensor, dict[str, Tensor]]:
    """Return the whole training loss, and its terms before weighting, detached, by name.

    Another term is an entry of `terms` and a weight of the same name in LossConfig. Other methods than M3Depth have a
    loss of their own.

    Args:
        output: Of the network, for images whose size is a multiple of 8.
        target: Their ground truth.
        config: Weights of the terms of M3Depth.
    """
    if not isinstance(output, StereoOutput):
        return rival_loss(output, target)
    weight = pixel_weights(target, config)
    within = target._replace(label=target.label & (target.disparity >= _least_disparity(target)))
    maps = trained_maps(output, within if config.depth else target, weight, config)
    knee, least = (PAPER_KNEE, 0.0) if config.depth else (NORMAL_KNEE, LEAST_WEIGHT)
    terms = {
        "disparity": _sum(m.share * disparity_loss(m.disparity, m.target, m.weight, config) for m in maps),
        "normal": _sum(m.share * normal_loss(m.normal, m.target, m.weight, knee, least) for m in maps),
        **({"consistency": maps_consistency(maps, config)} if config.consistency else {}),
        "confidence": confidence_loss(output, target),
        "sky": sky_loss(output, target, weight),
    }
    total = _sum(getattr(config, name) * value for name, value in terms.items())
    return total, {name: value.detach() for name, value in terms.items()}


def rival_loss(output: TrainedOutput, target: Target) -> tuple[Tensor, dict[str, Tensor]]:
    """Return the loss that is a method's own, and its terms, detached, by name.

    It sees what the published trainings see: pixels of known disparity, all of one weight. That the sky is trained with
    disparity 0 is our choice, since these methods have no output for the sky; LightStereo and TinyHITNet, for example,
    leave pixels of disparity 0 out of their loss.

    Args:
        output: Of the network.
        target: Ground truth at full size.
    """
    terms = output.terms(Truth(target.disparity, target.label | target.sky, target.normal))
    return _sum(terms.values()), {name: value.detach() for name, value in terms.items()}


def pixel_weights(target: Target, config: LossConfig) -> Tensor:
    """Return the weight of each pixel in the losses of disparity, normals and sky, (B, 1, H, W).

    Args:
        target: Ground truth at full size.
        config: Holds the weights of kinds of pixels.
    """
    weight = torch.ones_like(target.disparity)
    weight = torch.where(disparity_edges(target.disparity, target.valid), config.edge, weight)
    weight = torch.where(target.rock, config.rock, weight)
    weight = torch.where(target.one_eye, config.one_eye * weight, weight)
    return torch.where(target.rover, config.rover * weight, weight)


class TrainedMaps(NamedTuple):
    """Disparity and normals that the network returned on one grid, with what they are trained on.

    Attributes:
        share: Weight of their losses beside those of the last maps.
        cell: Side of a cell of the grid [px].
        disparity: (B, 1, h, w) [px of the full image].
        normal: (B, 3, h, w).
        target: Ground truth on this grid, with the camera of the full one.
        weight: (B, 1, h, w) weight of the cells.
    """

    share: float
    cell: int
    disparity: Tensor
    normal: Tensor
    target: Target
    weight: Tensor


def trained_maps(output: StereoOutput, target: Target, weight: Tensor, config: LossConfig) -> list[TrainedMaps]:
    """Return all maps that are trained: the last ones, those of the steps from the last to the first, and the initial.

    Args:
        output: Of the network.
        target: Ground truth at full size.
        weight: (B, 1, H, W) weight of the pixels.
        config: Holds the shares of the steps and of the initial maps.
    """
    maps = [TrainedMaps(1.0, 1, output.disparity, output.normal, target, weight)]
    quarter = reduce_target(target, CELL, weight)
    for age, step in enumerate(output.steps[::-1]):
        maps.append(TrainedMaps(config.decay ** (age + 1), CELL, *step, *quarter))
    if output.initial is not None:  # at 1/8, or on the grid of the output head
        cell = target.disparity.shape[-1] // output.initial[0].shape[-1]
        maps.append(TrainedMaps(config.initial, cell, *output.initial, *reduce_target(target, cell, weight)))
    return maps


def maps_consistency(maps: list[TrainedMaps], config: LossConfig) -> Tensor:
    """Return L_c of the last maps, and that of the others times their share and config.consistent_steps.

    Args:
        maps: As `trained_maps` returns them, the last ones of the network first.
        config: Holds consistent_steps, and whether it is that of depth.
    """
    last, *earlier = maps
    losses = [_grid_consistency(last, config.depth)]
    if config.consistent_steps:
        losses += [config.consistent_steps * m.share * _grid_consistency(m, config.depth) for m in earlier]
    return _sum(losses)


def _grid_consistency(maps: TrainedMaps, depth: bool) -> Tensor:
    """Return L_c on one grid, whose pixels are its cells: that of depth over FARTHEST_SCORED, or of disparity."""
    target, cell = maps.target, maps.cell
    smooth = target.label & ~disparity_edges(target.disparity, target.valid, float(cell))
    camera = target.camera if cell == 1 else scale_camera(target.camera, cell)
    if not depth:
        return consistency_loss(maps.disparity / cell, maps.normal, camera, smooth)
    residual = depth_consistency_residual(scaled_depth(maps.disparity, target), maps.normal, camera)
    return _norm_of_residual(*residual, PAPER_KNEE, smooth)


def confidence_loss(output: StereoOutput, target: Target) -> Tensor:
    """Return the cross-entropy of the decision "within 1 px", which no disparity of the sky is.

    Args:
        output: Of the network.
        target: Ground truth at full size.
    """
    decided = target.label | target.sky
    correct = target.label & ((output.disparity.detach() - target.disparity).abs() < 1)
    return _decision_loss(output.confidence, correct, decided.to(target.disparity))


def sky_loss(output: StereoOutput, target: Target, weight: Tensor) -> Tensor:
    """Return the cross-entropy of the decision "sky or too far to measure".

    Args:
        output: Of the network.
        target: Ground truth at full size.
        weight: (B, 1, H, W) weight of the pixels.
    """
    return _decision_loss(output.sky, target.sky, (target.label | target.sky) * weight)


def _decision_loss(logit: Tensor, truth: Tensor, weight: Tensor) -> Tensor:
    """Return the cross-entropy of a logit with a yes-or-no truth, averaged under a weight; all (B, 1, H, W)."""
    return weighted_mean(F.binary_cross_entropy_with_logits(logit, truth.to(weight), reduction="none"), weight)


def _sum(losses: Iterable[Tensor]) -> Tensor:
    """Return the sum of losses, at least one, in their order."""
    return reduce(torch.add, losses)
