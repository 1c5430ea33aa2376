"""What the rivals return for a batch of pairs, and how it is trained."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol, Self

import torch
import torch.nn.functional as F
from torch import Tensor


class Truth(NamedTuple):
    """Ground truth of a batch.

    Attributes:
        disparity: (B, 1, H, W) [px], 0 in the sky.
        valid: (B, 1, H, W) bool, the pixels that are trained, the sky among them.
        normal: (B, 3, H, W), unit length; 0 where it is unknown, and in the sky.
    """

    disparity: Tensor
    valid: Tensor
    normal: Tensor


class TrainedOutput(Protocol):
    """The maps of a rival, as network.output.Maps, with its own loss."""

    @property
    def disparity(self) -> Tensor: ...

    def cropped(self, height: int, width: int) -> Self:
        """Cut the maps to an image of height x width [px], which lies at their upper left."""
        ...

    def terms(self, truth: Truth) -> dict[str, Tensor]:
        """Return the weighted terms of the loss by name; their sum is minimised.

        The file of the method says where they differ from the published ones.
        """
        ...


@dataclass(frozen=True, kw_only=True)
class DisparityOutput:
    """What a method for disparity returns beside it: no normals, no confidence and no map of the sky."""

    normal: Tensor | None = None
    confidence: Tensor | None = None
    sky: Tensor | None = None


@dataclass(frozen=True)
class SequenceOutput(DisparityOutput):
    """Disparity maps at full size that are all trained, the last one being the result.

    Attributes:
        maps: (B, 1, H, W) each [px].
        shares: Weight of the loss of each map.
        knee: Error at which the loss turns from a parabola to a line [px]; 0 is the absolute error.
    """

    maps: Sequence[Tensor]
    shares: Sequence[float]
    knee: float = 0.0

    @property
    def disparity(self) -> Tensor:
        """The last map."""
        return self.maps[-1]

    def cropped(self, height: int, width: int) -> SequenceOutput:
        """Cut the maps to an image of height x width [px]."""
        return replace(self, maps=[x[..., :height, :width] for x in self.maps])

    def terms(self, truth: Truth) -> dict[str, Tensor]:
        """Return the sum of the maps' losses, each a mean over the valid pixels."""
        losses = [
            share * mean_over(distance(x - truth.disparity, self.knee), truth.valid)
            for x, share in zip(self.maps, self.shares, strict=True)
        ]
        return {"disparity": torch.stack(losses).sum()}


def distance(error: Tensor, knee: float) -> Tensor:
    """Return |error|, or with a knee above 0 the smooth L1 distance that is quadratic up to it."""
    return F.smooth_l1_loss(error, torch.zeros_like(error), beta=knee, reduction="none")


def mean_over(values: Tensor, mask: Tensor) -> Tensor:
    """Return the mean of values over a mask of the same shape; 0 where it is empty."""
    # a product would let the NaN of a masked pixel through
    return torch.where(mask, values, torch.zeros_like(values)).sum() / mask.sum().clamp(min=1)


def fading_shares(count: int, decay: float) -> list[float]:
    """Return the weights of a sequence of maps: 1 for the last, and `decay` times that of the next for the others."""
    return [decay ** (count - 1 - place) for place in range(count)]
