"""What the rivals share: the form of their images, and their place beside M3Depth."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import torch
from torch import Tensor

from m3depth.network.checkpointing import Caller, direct, recomputed
from m3depth.network.output import GridMap, padded
from m3depth.network.stereo_network import StereoNetwork
from m3depth.rivals.config import RivalConfig
from m3depth.rivals.output import SequenceOutput, TrainedOutput
from m3depth.stereo.pairs import MAX_DISPARITY


class Rival(StereoNetwork):
    """A method beside M3Depth, for disparity or for normals.

    Images are padded to a multiple of MULTIPLE. Group normalisation stands where a paper has batch normalisation, as in
    M3Depth: with the few crops that a CPU takes, batch statistics degrade the result. Pairs whose disparities are
    larger than `reach` are reduced.
    """

    config: RivalConfig
    MULTIPLE: ClassVar[int] = 32

    @property
    def reach(self) -> float:
        """The largest disparity that is trained [px]; a subclass whose search may end before returns that."""
        return MAX_DISPARITY

    @property
    def size_multiple(self) -> int:
        """Images are padded to heights and widths that are multiples of this [px]."""
        return self.MULTIPLE

    @property
    def call(self) -> Caller:
        """How parts are called that activation checkpointing computes twice."""
        return recomputed if self.recompute and torch.is_grad_enabled() else direct


class StereoRival(Rival):
    """A method for disparity. A subclass defines `estimate`."""

    def forward(self, left: Tensor, right: Tensor, camera: Tensor) -> TrainedOutput:
        """Run the network on a batch.

        Args:
            left, right: (B, 3, H, W) float in [0, 1], rectified, of any size.
            camera: (B, 4) fx, fy, cx, cy [px].
        """
        height, width = left.shape[-2:]
        # With the channels last, as batches come, PyTorch 2's backward pass through the context encoder of RAFT-Stereo
        # wrote beyond its memory, and ended the process.
        left, right = (2 * padded(x, self.MULTIPLE).contiguous() - 1 for x in (left, right))
        output = self.estimate(left, right, camera.float())
        self._check(output, left)
        return output.cropped(height, width)

    def estimate(self, left: Tensor, right: Tensor, camera: Tensor) -> TrainedOutput:
        """Return the maps of a batch.

        The network runs in bfloat16 where its device is fast in it, but disparities must be computed in float32: in
        bfloat16, those over 64 px are multiples of half a pixel. layers.in_float32 calls a part so.

        Args:
            left, right: (B, 3, H, W) in [-1, 1], H and W multiples of MULTIPLE.
            camera: (B, 4) [px].

        Returns:
            The maps, of which `disparity` is (B, 1, H, W) float32 [px].
        """
        raise NotImplementedError

    def _check(self, output: TrainedOutput, left: Tensor) -> None:
        """Raise ValueError unless an output and its disparity maps have the form that `estimate` must return."""
        name = f"{type(self).__name__}.estimate"
        if not {"disparity", "cropped", "terms"} <= set(dir(output)):
            raise ValueError(f"{name}: must return an output of m3depth.rivals.output, got {type(output).__name__}")
        maps: Sequence[object] = output.maps if isinstance(output, SequenceOutput) else [output.disparity]
        if not (isinstance(maps, list | tuple) and maps):
            raise ValueError(f"{name}: maps must be a list of one map or more, got {type(maps).__name__}")
        if isinstance(output, SequenceOutput) and len(output.shares) != len(maps):
            raise ValueError(f"{name}: shares must be as many numbers as there are maps, {len(maps)}")
        batch, _, height, width = left.shape
        for disparity in maps:
            if not isinstance(disparity, Tensor):
                raise ValueError(f"{name}: disparities must be tensors, got {type(disparity).__name__}")
            shape, dtype = tuple(disparity.shape), str(disparity.dtype).removeprefix("torch.")
            if shape != (batch, 1, height, width):
                raise ValueError(f"{name}: disparities must have the shape {(batch, 1, height, width)}, got {shape}")
            if disparity.dtype not in (torch.float32, torch.float64):
                raise ValueError(
                    f"{name}: disparities must be float32, got {dtype}, which would round them; compute them in "
                    "float32, as m3depth.rivals.layers.in_float32 calls a part of a network"
                )


class SteppedRival(StereoRival):
    """A method that refines one disparity map step by step, and whose output is the sequence of these maps."""

    @property
    def takes_steps(self) -> bool:
        """Whether the network refines its disparity step by step."""
        return True

    def steps_of(self, output: SequenceOutput) -> list[GridMap]:
        """Return the disparity after each step; the last one is the result."""
        return [GridMap(f"step {number}", disparity, 1) for number, disparity in enumerate(output.maps, start=1)]
