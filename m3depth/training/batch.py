"""Batches of tensors, stacked from packed samples."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from m3depth.training.losses import Target
from m3depth.training.packing import DISPARITY_UNIT, ROCK, SCORED, SKY, TRAINED, PackedSample


class Batch(NamedTuple):
    """Crops as tensors.

    Attributes:
        left, right: (B, 3, H, W) float32 in [0, 1].
        target: Their ground truth.
    """

    left: Tensor
    right: Tensor
    target: Target

    def to(self, device: torch.device) -> Batch:
        """Return the batch on another device."""
        move = [x.to(device, non_blocking=True) for x in self.target]
        return Batch(self.left.to(device, non_blocking=True), self.right.to(device, non_blocking=True), Target(*move))

    def split(self, parts: int) -> list[Batch]:
        """Return the batch in `parts` equal parts."""
        pieces = [x.chunk(parts) for x in (self.left, self.right, *self.target)]
        return [Batch(left, right, Target(*rest)) for left, right, *rest in zip(*pieces)]


def to_batch(items: Sequence[tuple[np.ndarray, np.ndarray, PackedSample]]) -> Batch:
    """Stack triples of left image, right image and packed ground truth, all of one size."""

    def stack(arrays: list[np.ndarray]) -> Tensor:
        stacked = torch.from_numpy(np.stack(arrays))
        return stacked.permute(0, 3, 1, 2) if stacked.ndim == 4 else stacked[:, None]

    truths = [truth for _, _, truth in items]
    flags = stack([t.flags for t in truths])
    normal = stack([t.normal for t in truths]).float()
    target = Target(
        stack([t.disparity.astype(np.float32) for t in truths]) * DISPARITY_UNIT,
        normal * normal.square().sum(1, keepdim=True).clamp(min=1).rsqrt(),
        (flags & TRAINED) > 0,
        (flags & SKY) > 0,
        (flags & ROCK) > 0,
        torch.tensor([t.camera for t in truths], dtype=torch.float32),
    )
    return Batch(stack([left for left, _, _ in items]), stack([right for _, right, _ in items]), target)


def whole_batch(sample: PackedSample) -> Batch:
    """Return one sample at full size, without augmentation, for validation; its label is the scored pixels alone."""
    scale = np.float32(1 / 255)
    batch = to_batch([(sample.left * scale, sample.right * scale, sample)])
    scored = torch.from_numpy((sample.flags & SCORED) > 0)[None, None]
    return batch._replace(target=batch.target._replace(label=scored))
