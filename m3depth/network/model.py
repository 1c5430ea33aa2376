"""M3Depth: depth and surface normals from a rectified stereo pair."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar, NamedTuple

import torch
from torch import Tensor, nn

from m3depth.network.backbone import Backbone, Features, normalised
from m3depth.network.checkpointing import Caller, direct, recomputed
from m3depth.network.config import PRESETS, M3DepthConfig
from m3depth.network.cost_volume import Aggregation, group_correlation_volume, matchable, soft_argmin
from m3depth.network.fine_correction import FineCorrection
from m3depth.network.geometry import facing_normals, pixel_rays, resize, scale_camera, unit
from m3depth.network.normal_branch import SNNet
from m3depth.network.output import VOLUME_STEP, GridMap, Start, StereoOutput, fitted, padded, unpadded
from m3depth.network.refinement import CELL, Refinement
from m3depth.network.row_bands import by_rows
from m3depth.network.stereo_network import StereoNetwork
from m3depth.weights import SHIPPED_WEIGHTS
from m3depth.weights.config_json import kind_of
from m3depth.weights.storage import load_weights


class InitialMaps(NamedTuple):
    """The maps of a pair that the refinement starts from, found in its cost volume or on a smaller pair.

    Attributes:
        disparity: (B, 1, h, w) [px of the full-size image].
        normal: (B, 3, h, w).
        context: (B, C, H / 8, W / 8) features of the aggregation; None without them.
        cell: Side of a cell of h x w [px].
    """

    disparity: Tensor
    normal: Tensor
    context: Tensor | None
    cell: int


class M3Depth(StereoNetwork):
    """The network. `infer` takes images as they come, `forward` takes batches of tensors.

    Attributes:
        config: The sizes of the network.
    """

    config: M3DepthConfig
    TAKES_START: ClassVar[bool] = True

    def __init__(self, config: M3DepthConfig | None = None) -> None:
        super().__init__()
        self.config = c = config or M3DepthConfig()
        half, _, eighth = c.channels
        self.backbone = Backbone(c.channels, c.wavelet_levels, c.wavelet_kernel, c.feature_skips)
        self.match = nn.Conv2d(eighth, c.match_channels, 1) if c.match_channels else None
        self.aggregation = Aggregation(c)
        self.normals = SNNet(c)
        self.refinement: Refinement | None = None
        self.fine: FineCorrection | None = None
        self.decisions: nn.Conv2d | None = None
        if c.refines:
            self.refinement = Refinement(c)
            if c.fine_width:
                self.fine = FineCorrection(half, c.hidden, c.fine_width)
        else:
            self.decisions = nn.Conv2d(c.coarse_width, 2, 3, padding=1)
        for layer in self.modules():  # twice as fast on a CPU; Module.to() fails on the 3-D convolutions
            if isinstance(layer, nn.Conv2d):
                layer.weight.data = layer.weight.data.contiguous(memory_format=torch.channels_last)

    @classmethod
    def from_preset(cls, name: str) -> M3Depth:
        """Make a new network with random weights.

        Args:
            name: "lite", "paper" or "paper-thin".

        Raises:
            ValueError: There is no such preset.
        """
        if name not in PRESETS:
            raise ValueError(f"preset {name!r} is not one of {', '.join(PRESETS)}")
        return cls(PRESETS[name])

    @classmethod
    def from_pretrained(cls, path: str | Path | None = None) -> M3Depth:
        """Load a trained network, in evaluation mode.

        Args:
            path: A .safetensors file that save_pretrained wrote; None loads the weights that come with the package.

        Raises:
            FileNotFoundError: There is no such file.
            ValueError: The file cannot be used. The message, one line, names it.
        """
        source = SHIPPED_WEIGHTS if path is None else Path(path)
        config, tensors = load_weights(source)
        if (kind := kind_of(config)) != M3DepthConfig.KIND:
            raise ValueError(f"{source}: holds weights of {kind}, not of M3Depth")
        try:
            network = M3DepthConfig.from_dict(config)
        except ValueError as error:
            raise ValueError(f"{source}: {error}") from None
        return cls.restored(network, tensors, source)

    @property
    def size_multiple(self) -> int:
        """Images are padded to heights and widths that are multiples of this [px]."""
        return self.config.size_multiple

    @property
    def reach(self) -> float:
        """Disparity at which the hypotheses end [px]."""
        return VOLUME_STEP * self.config.hypotheses

    @property
    def goes_on(self) -> bool:
        """Whether the network has a refinement."""
        return self.config.refines

    @property
    def takes_steps(self) -> bool:
        """Whether the refinement has recurrent steps."""
        return self.config.refine_steps > 0

    def steps_of(self, output: StereoOutput) -> list[GridMap]:
        """Return the disparity of soft argmin, that after each step at 1/4, and the result."""
        maps = [GridMap(f"step {n}", disparity, CELL) for n, (disparity, _) in enumerate(output.steps, start=1)]
        if output.initial is not None:
            maps.insert(0, GridMap("first map", output.initial[0], VOLUME_STEP >> self.config.output_head))
        return [*maps, GridMap("result", output.disparity, 1)]

    def forward(self, left: Tensor, right: Tensor, camera: Tensor, start: Start | None = None) -> StereoOutput:
        """Run the network on a batch.

        Args:
            left, right: (B, 3, H, W) float in [0, 1], rectified, of any size.
            camera: (B, 4) fx, fy, cx, cy [px].
            start: Where the refinement starts, from the same pair at a smaller size; None: the cost volume finds it,
                for disparities up to 8 px times config.hypotheses.
        """
        height, width = left.shape[-2:]
        multiple, camera = self.config.size_multiple, camera.float()
        call = recomputed if self.recompute and torch.is_grad_enabled() else direct
        pair = normalised(padded(left, multiple), padded(right, multiple))
        features = call(self.backbone, pair, start is None)
        left8 = features.eighth.chunk(2)[0] if start is None else features.eighth  # (B, C8, H / 8, W / 8)
        if start is None:
            first = self._match(features, camera, call)
        else:
            first = InitialMaps(padded(start.disparity, multiple), padded(start.normal, multiple), start.context, 1)
        count = self.config.refine_steps if start is None else self.config.finer_steps
        maps, steps = self._refine(features, left8, first, camera, count, call)
        maps = maps[..., :height, :width]
        if self.training:  # one that faces away would hardly have a gradient
            normal = unit(maps[:, 1:4])
        else:
            normal = by_rows(facing_normals, maps[:, 1:4], pixel_rays(camera, height, width))
        initial = None if start is not None else unpadded(first[:2], height, width, first.cell)
        steps = [unpadded(step, height, width, CELL) for step in steps]
        context = first.context
        if context is not None:
            context = fitted(context, -(-height // VOLUME_STEP), -(-width // VOLUME_STEP))
        return StereoOutput(maps[:, :1], normal, maps[:, 4:5], maps[:, 5:6], initial, steps, context)

    def _match(self, features: Features, camera: Tensor, call: Caller) -> InitialMaps:
        """Find disparity and normals in the cost volume, by soft argmin and SNNet.

        Args:
            features: Of the 2 B images, left ones first.
            camera: (B, 4) [px].
            call: How a part of the network is called.
        """
        left8 = features.eighth.chunk(2)[0]  # (B, C8, H / 8, W / 8)
        matched = features.eighth if self.match is None else self.match(features.eighth)
        match_left, match_right = matchable(matched.float().contiguous()).chunk(2)
        volume = group_correlation_volume(match_left, match_right, self.config.hypotheses, self.config.groups)
        # From (B, groups, D, H / 8, W / 8) to the grid of `cell` px, which is finer with an output head.
        volume, scores, context = call(self.aggregation, volume, left8)
        cell = VOLUME_STEP >> self.config.output_head
        disparity = soft_argmin(scores.float(), VOLUME_STEP)  # (B, 1, H / cell, W / cell)
        # An exported graph keeps the size of the features free, but would fix that of the disparity.
        rays = pixel_rays(scale_camera(camera, cell), *(side * VOLUME_STEP // cell for side in left8.shape[-2:]))
        normal = call(self.normals, volume, left8, rays)  # (B, 3, H / cell, W / cell)
        return InitialMaps(disparity, normal, None if context is None else resize(context, left8.shape[-2:]), cell)

    def _refine(
        self, features: Features, left8: Tensor, first: InitialMaps, camera: Tensor, count: int, call: Caller
    ) -> tuple[Tensor, list[tuple[Tensor, Tensor]]]:
        """Bring the first maps to full size, by the refinement and the fine correction where the network has them.

        Args:
            features: Of the 2 B images, left ones first.
            left8: (B, C8, H / 8, W / 8), the left ones at 1/8.
            first: The maps to start from.
            camera: (B, 4) [px].
            count: Number of refinement steps.
            call: How a part of the network is called.

        Returns:
            (B, 6, H, W) disparity, normal (not normalised), confidence logit and sky logit; and the maps of the steps.
        """
        coarse = left8
        if first.context is not None:  # (B, coarse_width, H / 8, W / 8)
            coarse = torch.cat([left8, fitted(first.context, *left8.shape[-2:])], 1)
        if self.refinement is None:
            assert self.decisions is not None
            size = torch.Size(VOLUME_STEP * side for side in left8.shape[-2:])
            maps = (first.disparity, first.normal, self.decisions(coarse).float())
            return torch.cat([resize(x, size) for x in maps], 1), []
        left4, right4 = features.quarter.chunk(2)  # (B, C4, H / 4, W / 4)
        disparity, normal = (resize(x, left4.shape[-2:]) for x in first[:2])
        steps, refined, hidden = self.refinement(
            left4, right4, coarse, disparity, unit(normal), scale_camera(camera, 4), count, call
        )
        if self.fine is not None:
            refined = refined + call(self.fine, *features.half.chunk(2), hidden, refined, camera)
        return refined, steps
