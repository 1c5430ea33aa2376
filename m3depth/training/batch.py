"""Batches of tensors, stacked from packed samples."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
import torch
from torch import Tensor

from m3depth.training.augmentation import crop, resized
from m3depth.training.losses import Target
from m3depth.training.packing import ROCK, SCORED, SKY, TRAINED, PackedSample


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
            there = [x.to(device, non_blocking=True) for x in (left, right, *target)]
            return there[0], there[1], Target(*there[2:])

        finer = tuple(FinerBand(*band[:3], *moved(*band[3:])) for band in self.finer)
        return Batch(*moved(self.left, self.right, self.target), finer)

    def split(self, parts: int) -> list[Batch]:
        """Return the batch in `parts` equal parts."""
        pieces = [x.chunk(parts) for x in (self.left, self.right, *self.target)]
        each = len(pieces[0][0])
        out = []
        for n, (left, right, *rest) in enumerate(zip(*pieces)):
            own = (b._replace(crop=b.crop - n * each) for b in self.finer if n * each <= b.crop < (n + 1) * each)
            out.append(Batch(left, right, Target(*rest), tuple(own)))
        return out


def to_batch(items: Sequence[tuple[np.ndarray, np.ndarray, PackedSample]]) -> Batch:
    """Stack triples of left image, right image and packed ground truth, all of one size."""

    def stack(arrays: list[np.ndarray]) -> Tensor:
        stacked = torch.from_numpy(np.stack(arrays))
        return stacked.permute(0, 3, 1, 2) if stacked.ndim == 4 else stacked[:, None]

    truths = [truth for _, _, truth in items]
    flags = stack([t.flags for t in truths])
    normal = stack([t.normal for t in truths]).float()
    target = Target(
        stack([t.disparity for t in truths]),
        normal * normal.square().sum(1, keepdim=True).clamp(min=1).rsqrt(),
        (flags & TRAINED) > 0,
        (flags & SKY) > 0,
        (flags & ROCK) > 0,
        torch.tensor([t.camera for t in truths], dtype=torch.float32),
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
