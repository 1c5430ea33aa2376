"""The outputs of the network for a batch of pairs, the start that they give to a larger pair, and the padding."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import torch
import torch.nn.functional as F
from torch import Tensor

from m3depth.network.geometry import MIN_DISPARITY, unit
from m3depth.stereo.prediction import StepMap

VOLUME_STEP = 8  # [px] disparity between two hypotheses: a cell of the volume, which is at 1/8


class Start(NamedTuple):
    """What a reduced pair says about a larger one, whose refinement starts there. The cost volume is left out then.

    Attributes:
        disparity: (B, 1, H, W) [px of the larger image].
        normal: (B, 3, H, W), unit length.
        context: (B, C, ceil(H / 8), ceil(W / 8)), of the aggregation; None for networks without it.
    """

    disparity: Tensor
    normal: Tensor
    context: Tensor | None

    def rows(self, top: int, count: int) -> Start:
        """Return some rows.

        Args:
            top: First row [px], a multiple of 8.
            count: Number of rows [px].
        """
        first, last = top // VOLUME_STEP, -(-(top + count) // VOLUME_STEP)
        return Start(
            self.disparity[:, :, top : top + count],
            self.normal[:, :, top : top + count],
            None if self.context is None else self.context[:, :, first:last],
        )


class Maps(Protocol):
    """What every network returns for a batch of pairs, all float32.

    Attributes:
        disparity: (B, 1, H, W) [px].
        normal: (B, 3, H, W), unit length, facing the camera; None without normals.
        confidence: (B, 1, H, W), logit of "the disparity is within 1 px"; None without confidence.
        sky: (B, 1, H, W), logit of "sky or too far to measure"; None without a map of the sky.
    """

    @property
    def disparity(self) -> Tensor: ...
    @property
    def normal(self) -> Tensor | None: ...
    @property
    def confidence(self) -> Tensor | None: ...
    @property
    def sky(self) -> Tensor | None: ...


class PlainMaps(NamedTuple):
    """Maps without anything else; attributes as of Maps."""

    disparity: Tensor
    normal: Tensor | None
    confidence: Tensor | None
    sky: Tensor | None


def maps_at_size(maps: Maps, height: int, width: int) -> PlainMaps:
    """Return the maps of a reduced pair at the pair's own size, bilinearly interpolated.

    Args:
        maps: Those of the reduced pair.
        height, width: Size of the pair, whose pixels the disparities then count [px].
    """
    normal, confidence, sky = (
        None if x is None else F.interpolate(x.float(), (height, width), mode="bilinear")
        for x in (maps.normal, maps.confidence, maps.sky)
    )
    factor = width / maps.disparity.shape[-1]
    disparity = F.interpolate(maps.disparity.float(), (height, width), mode="bilinear") * factor
    return PlainMaps(disparity, None if normal is None else unit(normal), confidence, sky)


class StereoOutput(NamedTuple):
    """What forward returns, all float32. Disparities are pixels of the full-size image, normals have unit length.

    Attributes:
        disparity: (B, 1, H, W) [px].
        normal: (B, 3, H, W), facing the camera.
        confidence: (B, 1, H, W), logit of "the disparity is within 1 px".
        sky: (B, 1, H, W), logit of "sky or too far to measure".
        initial: Disparity and normal of soft argmin and SNNet, at 1/8 or on the grid of the output head; None where
            the refinement began at a Start.
        steps: Disparity and normal at 1/4 after each refinement step. These normals, and the initial ones, may point
            away from the camera.
        context: (B, C, ceil(H / 8), ceil(W / 8)) features of the aggregation, for a larger pair; None without them.
    """

    disparity: Tensor
    normal: Tensor
    confidence: Tensor
    sky: Tensor
    initial: tuple[Tensor, Tensor] | None
    steps: list[tuple[Tensor, Tensor]]
    context: Tensor | None = None

    def pair(self, index: int) -> StereoOutput:
        """Return the final maps and the context of one pair of the batch, as a batch of one."""
        one = slice(index, index + 1)
        maps = self.disparity[one], self.normal[one], self.confidence[one], self.sky[one]
        return StereoOutput(*maps, None, [], None if self.context is None else self.context[one])

    def start(self, height: int, width: int) -> Start:
        """Return what these maps say about the same pair at a larger size, without gradient.

        Args:
            height, width: Size of the larger images [px].
        """
        rows, columns = self.disparity.shape[-2:]
        size = (height, width)
        disparity = F.interpolate(self.disparity.detach(), size, mode="bilinear") * (width / columns)
        normal = unit(F.interpolate(self.normal.detach(), size, mode="bilinear"))
        context = self.context
        if context is not None:
            # cells are 8 px of either image; the last ones of a row and a column may reach over its border
            larger = F.interpolate(
                context.detach().float(), scale_factor=(height / rows, width / columns), mode="bilinear"
            )
            context = fitted(larger, -(-height // VOLUME_STEP), -(-width // VOLUME_STEP)).to(context.dtype)
        return Start(disparity, normal, context)


class GridMap(NamedTuple):
    """A disparity that a network computed on the way to its result.

    Attributes:
        name: As of StepMap.
        disparity: (1, 1, h, w) [px of the images in which the network works].
        cell: Side of a cell of h x w [px of these images].
    """

    name: str
    disparity: Tensor
    cell: int

    def at_size(self, working_size: tuple[int, int], size: tuple[int, int]) -> StepMap:
        """Return the map at the size of the pair.

        Args:
            working_size: Height and width of the images in which the network works [px].
            size: Height and width of the pair [px].
        """
        height, width = working_size
        maps = self.disparity.float()
        if self.cell > 1:
            maps = F.interpolate(maps, scale_factor=float(self.cell), mode="bilinear")[..., :height, :width]
        if (height, width) != size:
            maps = F.interpolate(maps, size, mode="bilinear") * (size[1] / width)
        maps = torch.where(maps < MIN_DISPARITY, torch.zeros_like(maps), maps)
        return StepMap(self.name, (height, width), maps[0, 0].cpu().numpy())


def fitted(maps: Tensor, height: int, width: int) -> Tensor:
    """Cut maps (B, C, h, w) to (B, C, height, width), or repeat their last row and column up to it."""
    maps = maps[..., :height, :width]
    missing = (0, width - maps.shape[-1], 0, height - maps.shape[-2])
    return F.pad(maps, missing, mode="replicate") if any(missing) else maps


def padded_size(height: int, width: int, multiple: int) -> tuple[int, int]:
    """Return the height and the width [px] to which `padded` enlarges maps."""
    return -(-height // multiple) * multiple, -(-width // multiple) * multiple


def padded(maps: Tensor, multiple: int) -> Tensor:
    """Repeat the last row and column of maps (B, C, H, W) until H and W are multiples of a number.

    The padding lies to the right and below, so that the principal point stays where it is.

    Args:
        maps: Images, or maps of them.
        multiple: The number [px].
    """
    height, width = maps.shape[-2:]
    missing = (0, -width % multiple, 0, -height % multiple)
    return F.pad(maps, missing, mode="replicate") if any(missing) else maps


def unpadded(maps: tuple[Tensor, Tensor], height: int, width: int, cell: int) -> tuple[Tensor, Tensor]:
    """Cut disparity and normal on a grid of `cell` px to the cells of an image of height x width.

    Args:
        maps: Disparity (B, 1, h, w) and normal (B, 3, h, w) of the padded image.
        height: Height of the image [px].
        width: Width of the image [px].
        cell: Side of a cell of the maps [px].
    """
    first, second = (x[..., : -(-height // cell), : -(-width // cell)] for x in maps)
    return first, second
