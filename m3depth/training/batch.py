"""Batches of tensors, stacked from packed samples, and their ground truth on the images' grid and on coarser ones."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from m3depth.network.geometry import unit
from m3depth.training.augmentation import crop, resized
from m3depth.training.packing import ONE_EYE, ROCK, ROVER, SCORED, SKY, TRAINED, PackedSample


class Target(NamedTuple):
    """Ground truth of a batch.

    Attributes:
        disparity: (B, 1, H, W) [px]; 0 on sky and where it is unknown.
        normal: (B, 3, H, W), unit length; 0 where it is unknown.
        label: (B, 1, H, W) bool, the pixels that are trained.
        sky: (B, 1, H, W) bool.
        rock: (B, 1, H, W) bool.
        one_eye: (B, 1, H, W) bool, the pixels whose match is hidden from the right eye, or lies outside its crop.
        rover: (B, 1, H, W) bool, the rover that carries the cameras.
        camera: (B, 4) fx, fy, cx, cy [px].
        baseline: (B,) of the cameras [m].
    """

    disparity: Tensor
    normal: Tensor
    label: Tensor
    sky: Tensor
    rock: Tensor
    one_eye: Tensor
    rover: Tensor
    camera: Tensor
    baseline: Tensor

    @property
    def valid(self) -> Tensor:
        """(B, 1, H, W) bool, the pixels whose disparity is known, trained or not; maps of lidars, for example, have
        gaps.
        """
        return (self.disparity > 0) | self.sky


def network_inputs(batch: Batch, takes_truth: bool) -> tuple[Tensor, ...]:
    """Return what a network takes: both images, the cameras and, if it is given the truth, the disparity.

    Args:
        batch: The crops.
        takes_truth: See StereoNetwork.
    """
    truth = (batch.target.disparity,) if takes_truth else ()
    return batch.left, batch.right, batch.target.camera, *truth


def disparity_range(disparity: Tensor, valid: Tensor | None = None) -> Tensor:
    """Return the largest minus the smallest disparity in each 3 x 3 window. Level ground has B / h, half a pixel.

    Args:
        disparity: (B, 1, H, W) [px].
        valid: (B, 1, H, W) bool, the pixels that count; None for all.

    Returns:
        (B, 1, H, W) [px]; 0 where a window holds no such pixel.
    """
    if valid is None:
        high, low = disparity, -disparity
    else:
        high, low = (x.masked_fill(~valid, -torch.inf) for x in (disparity, -disparity))
    return (F.max_pool2d(high, 3, 1, 1) + F.max_pool2d(low, 3, 1, 1)).clamp(min=0)


def disparity_edges(disparity: Tensor, valid: Tensor | None = None, threshold: float = 1.0) -> Tensor:
    """Mark pixels whose 3 x 3 window spans more than `threshold` px of disparity: (B, 1, H, W) bool.

    Args:
        disparity: (B, 1, H, W) [px].
        valid: The pixels that are compared, see disparity_range; an edge in a gap of them is missed.
        threshold: [px].
    """
    return disparity_range(disparity, valid) > threshold


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
        return (middle(x) | ~valid).all(0) & middle(x & target.valid).any(0)

    disparity, valid = middle(target.disparity), middle(target.valid)
    span = disparity.masked_fill(~valid, -torch.inf).amax(0) - disparity.masked_fill(~valid, torch.inf).amin(0)
    mean = (disparity * valid).sum(0) / valid.sum(0).clamp(min=1)
    normal = unit(middle(target.normal).sum(0))
    trained, sky = alike(target.label) & (span < 1.0), alike(target.sky)
    rock, one_eye, rover = (middle(x).any(0) for x in (target.rock, target.one_eye, target.rover))
    reduced = Target(mean, normal, trained, sky, rock, one_eye, rover, target.camera, target.baseline)
    return reduced, middle(weight).amax(0)


class FinerBand(NamedTuple):
    """Some rows of a crop at its full resolution, where the refinement goes on after the reduced crop.

    Attributes:
        crop: Index of the reduced crop in its batch.
        size: Height and width of the crop at full resolution [px].
        top: First of the rows, a multiple of 8.
        left, right: (1, 3, h, W) float32 in [0, 1].
        target: Their ground truth.
    """

    crop: int
    size: tuple[int, int]
    top: int
    left: Tensor
    right: Tensor
    target: Target


class Batch(NamedTuple):
    """Crops as tensors.

    Attributes:
        left, right: (B, 3, H, W) float32 in [0, 1], reduced where the cost volume works on a reduced pair.
        target: Their ground truth.
        finer: Rows of reduced crops at full resolution.
    """

    left: Tensor
    right: Tensor
    target: Target
    finer: tuple[FinerBand, ...] = ()

    def to(self, device: torch.device) -> Batch:
        """Return the batch on another device."""

        def moved(left: Tensor, right: Tensor, target: Target) -> tuple[Tensor, Tensor, Target]:
            tensors = [x.to(device, non_blocking=True) for x in (left, right, *target)]
            return tensors[0], tensors[1], Target(*tensors[2:])

        finer = tuple(FinerBand(*band[:3], *moved(*band[3:])) for band in self.finer)
        return Batch(*moved(self.left, self.right, self.target), finer)

    def split(self, parts: int) -> list[Batch]:
        """Return the batch in `parts` equal parts."""
        pieces = [x.chunk(parts) for x in (self.left, self.right, *self.target)]
        each = len(pieces[0][0])
        out = []
        for n, (left, right, *rest) in enumerate(zip(*pieces)):
            bands = (b._replace(crop=b.crop - n * each) for b in self.finer if n * each <= b.crop < (n + 1) * each)
            out.append(Batch(left, right, Target(*rest), tuple(bands)))
        return out


def to_batch(items: Sequence[tuple[np.ndarray, np.ndarray, PackedSample]]) -> Batch:
    """Stack triples of left image, right image and packed ground truth, all of one size."""

    def stack(arrays: list[np.ndarray]) -> Tensor:
        stacked = torch.from_numpy(np.stack(arrays))
        return stacked.permute(0, 3, 1, 2) if stacked.ndim == 4 else stacked[:, None]

    truths = [truth for _, _, truth in items]
    flags = stack([t.flags for t in truths])
    normal = stack([t.normal for t in truths]).float()
    disparity = stack([t.disparity for t in truths])
    outside = torch.arange(disparity.shape[-1]) < disparity  # of the right image's crop, to the left
    target = Target(
        disparity,
        normal * normal.square().sum(1, keepdim=True).clamp(min=1).rsqrt(),
        (flags & TRAINED) > 0,
        (flags & SKY) > 0,
        (flags & ROCK) > 0,
        ((flags & ONE_EYE) > 0) | outside,
        (flags & ROVER) > 0,
        torch.tensor([t.camera for t in truths], dtype=torch.float32),
        torch.tensor([t.baseline for t in truths], dtype=torch.float32),
    )
    return Batch(stack([left for left, _, _ in items]), stack([right for _, right, _ in items]), target)


def whole_batch(sample: PackedSample) -> Batch:
    """Return one sample, without augmentation, for validation; its labels are the scored pixels alone.

    Where the cost volume works on a reduced pair, `finer` has the whole pair.
    """
    scale = np.float32(1 / 255)
    images = sample.left * scale, sample.right * scale
    if sample.reduction == 1:
        return scored_batch(*images, sample)
    whole, height, width = scored_batch(*images, sample), *sample.left.shape[:2]
    first = scored_batch(*reduced(images, sample))
    return first._replace(finer=(FinerBand(0, (height, width), 0, *whole[:3]),))


def scored_batch(left: np.ndarray, right: np.ndarray, sample: PackedSample) -> Batch:
    """Return one pair, images (H, W, 3) float32 in [0, 1], as a batch whose labels are the scored pixels alone."""
    batch = to_batch([(left, right, sample)])
    scored = torch.from_numpy((sample.flags & SCORED) > 0)[None, None]
    return batch._replace(target=batch.target._replace(label=scored))


def reduced(images: tuple[np.ndarray, np.ndarray], sample: PackedSample) -> tuple[np.ndarray, np.ndarray, PackedSample]:
    """Return a pair, (H, W, 3) float32 each, and its ground truth as small as the cost volume takes them."""
    height, width = (max(1, round(side / sample.reduction)) for side in sample.left.shape[:2])
    left, right = (cv2.resize(x, (width, height), interpolation=cv2.INTER_AREA) for x in images)
    return left, right, resized(sample, (height, width))


def finer_band(
    index: int, images: tuple[np.ndarray, np.ndarray], sample: PackedSample, top: int, rows: int
) -> FinerBand:
    """Cut rows out of a crop at full resolution.

    Args:
        index: Index of the reduced crop in its batch.
        images: (H, W, 3) float32 in [0, 1] each.
        sample: Ground truth of the crop.
        top: First row, a multiple of 8.
        rows: Number of rows.
    """
    height, width = sample.left.shape[:2]
    left, right = (x[top : top + rows] for x in images)
    batch = to_batch([(left, right, crop(sample, top, 0, rows, width))])
    return FinerBand(index, (height, width), top, *batch[:3])
