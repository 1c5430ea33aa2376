"""M3Depth: depth and surface normals from a rectified stereo pair."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor, nn

from m3depth.network.backbone import Backbone, Features
from m3depth.network.checkpointing import Caller, direct, recomputed
from m3depth.network.config import FARTHEST_STEP, PRESETS, M3DepthConfig
from m3depth.network.cost_volume import Aggregation, group_correlation_volume, matchable, soft_argmin
from m3depth.network.device import autocast, fast_dtype
from m3depth.network.fine_correction import FineCorrection
from m3depth.network.geometry import (
    MIN_DISPARITY,
    disparity_to_depth,
    face_camera,
    pixel_rays,
    resize,
    scale_camera,
    unit,
)
from m3depth.network.normal_branch import SNNet
from m3depth.network.refinement import Refinement
from m3depth.network.row_bands import by_rows
from m3depth.network.weights_file import load_weights, save_weights
from m3depth.stereo.pairs import NEAREST, checked_pair, in_colour
from m3depth.stereo.prediction import Prediction
from m3depth.stereo.sky import possible_sky
from m3depth.weights import SHIPPED_WEIGHTS
from marssim.base.camera import StereoRig

VOLUME_STEP = 8  # [px] disparity between two hypotheses: a cell of the volume, which is at 1/8
LEAST_GAIN = 1.2  # factor from which the refinement goes on at a larger size
SAME = 1.01  # factor up to which two sizes are one


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

    def of(self, index: int) -> StereoOutput:
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


class M3Depth(nn.Module):
    """The network. `infer` takes images as they come, `forward` takes batches of tensors.

    Attributes:
        config: The sizes of the network.
        recompute: Activation checkpointing. In training, large parts keep only their inputs, and the backward pass
            computes them once more: the same gradients with less memory, about a third slower.
    """

    recompute = False

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
        if c.refine_steps:
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
            name: "lite" or "paper".

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
        try:
            network = M3DepthConfig.from_dict(config)
            with torch.device("meta"):  # shapes alone: a config with wrong, huge sizes then takes no memory
                expected = cls(network).state_dict()
        except ValueError as error:
            raise ValueError(f"{source}: {error}") from None
        misfits = sorted(expected.keys() ^ tensors.keys())
        misfits = misfits or sorted(k for k in expected if expected[k].shape != tensors[k].shape)
        if misfits:
            raise ValueError(
                f"{source}: {len(misfits)} tensors do not fit the network that the file describes, the first is "
                f"{misfits[0]!r}; use the file as m3depth.train wrote it"
            )
        model = cls(network)
        model.load_state_dict(tensors)
        return model.eval()

    def save_pretrained(self, path: str | Path) -> None:
        """Write weights (.safetensors) and, beside them, their config (.json). Replaces existing files atomically.

        Raises:
            ValueError: path does not end in .safetensors.
        """
        save_weights(Path(path), asdict(self.config), self.state_dict())

    def forward(self, left: Tensor, right: Tensor, camera: Tensor, start: Start | None = None) -> StereoOutput:
        """Run the network on a batch.

        Args:
            left, right: (B, 3, H, W) float in [0, 1], rectified, of any size.
            camera: (B, 4) fx, fy, cx, cy [px].
            start: Where the refinement starts, from the same pair at a smaller size; None: the cost volume finds it,
                for disparities up to `reach`.
        """
        height, width = left.shape[-2:]
        multiple = self.config.size_multiple
        padding = (0, -width % multiple, 0, -height % multiple)  # right and bottom: the principal point stays
        if any(padding):
            left, right = (F.pad(image, padding, mode="replicate") for image in (left, right))
        camera = camera.float()
        # Both images share one mean and contrast: this evens out low contrast, and keeps gains between the two.
        mean = left.mean((1, 2, 3), keepdim=True)
        scale = left.std((1, 2, 3), keepdim=True).clamp(min=0.01)
        images = (torch.cat([left, right]) - torch.cat([mean, mean])) / torch.cat([scale, scale])
        call = recomputed if self.recompute and torch.is_grad_enabled() else direct
        features = call(self.backbone, images.contiguous(memory_format=torch.channels_last))  # of 2 B images
        left8 = features.eighth.chunk(2)[0]  # (B, C8, H / 8, W / 8)
        size, size8 = images.shape[-2:], left8.shape[-2:]
        initial = None
        if start is None:
            initial, context, cell = self._match(features, camera, size, call)
            disparity, normal = initial
        else:
            disparity, normal = (F.pad(x, padding, mode="replicate") for x in start[:2])
            context, cell = start.context, 1
        if context is not None:
            if start is None:
                context = resize(context, size8)
            # (B, coarse_width, H / 8, W / 8)
            left8 = torch.cat([left8, fitted(context, *size8)], 1)
        steps: list[tuple[Tensor, Tensor]] = []
        if self.refinement is not None:
            left4, right4 = features.quarter.chunk(2)  # (B, C4, H / 4, W / 4)
            disparity, normal = (resize(x, left4.shape[-2:]) for x in (disparity, normal))
            camera4 = scale_camera(camera, 4)
            count = self.config.refine_steps if start is None else self.config.finer_steps
            steps, maps, hidden = self.refinement(left4, right4, left8, disparity, unit(normal), camera4, count, call)
            if self.fine is not None:
                maps = maps + call(self.fine, *features.half.chunk(2), hidden, maps, camera)
        else:
            assert self.decisions is not None
            coarse = (disparity, normal, self.decisions(left8).float())
            maps = torch.cat([resize(x, size) for x in coarse], 1)
        maps = maps[..., :height, :width]  # (B, 6, H, W): disparity, normal, confidence, sky
        normal = by_rows(facing_normals, maps[:, 1:4], pixel_rays(camera, height, width))
        initial = None if initial is None else unpadded(initial, height, width, cell)
        steps = [unpadded(step, height, width, 4) for step in steps]
        if context is not None:
            context = fitted(context, -(-height // VOLUME_STEP), -(-width // VOLUME_STEP))
        return StereoOutput(maps[:, :1], normal, maps[:, 4:5], maps[:, 5:6], initial, steps, context)

    def _match(
        self, features: Features, camera: Tensor, size: torch.Size, call: Caller
    ) -> tuple[tuple[Tensor, Tensor], Tensor | None, int]:
        """Find the disparity in the cost volume.

        Args:
            features: Of the 2 B images, left ones first.
            camera: (B, 4) [px].
            size: Height and width of the images [px].
            call: How a part of the network is called.

        Returns:
            Disparity (B, 1, h, w) and normal (B, 3, h, w) of soft argmin and SNNet; the aggregation's context or None;
            and the side of a cell of h x w [px].
        """
        left8 = features.eighth.chunk(2)[0]
        matched = features.eighth if self.match is None else self.match(features.eighth)
        match_left, match_right = matchable(matched.float().contiguous()).chunk(2)
        volume = group_correlation_volume(match_left, match_right, self.config.hypotheses, self.config.groups)
        # From (B, groups, D, H / 8, W / 8) to the grid of `cell` px, which is finer with an output head.
        volume, scores, context = call(self.aggregation, volume, left8)
        cell = VOLUME_STEP >> self.config.output_head
        disparity = soft_argmin(scores.float(), VOLUME_STEP)  # (B, 1, H / cell, W / cell)
        rays = pixel_rays(scale_camera(camera, cell), size[0] // cell, size[1] // cell)
        normal = call(self.normals, volume, left8, rays)  # (B, 3, H / cell, W / cell)
        return (disparity, normal), context, cell

    @property
    def reach(self) -> int:
        """The disparity at which the hypotheses end [px]; `infer` begins with reduced images where more are needed."""
        return VOLUME_STEP * self.config.hypotheses

    def sizes(self, rig: StereoRig, nearest: float, max_pixels: int | None = None) -> list[tuple[int, int]]:
        """Return the heights and widths [px] at which `infer` works on a pair, from coarse to fine.

        The cost volume works at the first, where `nearest` is within its reach, and the refinement goes on at each of
        the others, at most FARTHEST_STEP times as large as the one before.

        Args:
            rig: The cameras of the images.
            nearest: Shortest distance [m] that the cost volume should find.
            max_pixels: Largest number of pixels; None: those of the images.
        """
        height, width = rig.camera.height, rig.camera.width
        finest = 1.0 if max_pixels is None else min(1.0, math.sqrt(max_pixels / (height * width)))
        first = min(finest, self.reach * nearest / rig.fb)
        gain = finest / first
        first = finest if gain < SAME else first
        more = math.ceil(math.log(gain, FARTHEST_STEP) - 1e-6) if gain >= LEAST_GAIN and self.refinement else 0
        scales = [first * gain ** (k / more) for k in range(1, more)] + [finest] * (more > 0)
        return [(max(1, round(height * scale)), max(1, round(width * scale))) for scale in (first, *scales)]

    @torch.inference_mode()
    def infer(
        self, left: np.ndarray, right: np.ndarray, rig: StereoRig, nearest: float | None = None,
        max_pixels: int | None = None,
    ) -> Prediction:  # fmt: skip
        """Estimate depth, disparity, normals and confidence of one rectified pair, at the input's size.

        Where `nearest` is a larger disparity than the hypotheses reach (192 px), the cost volume finds the disparities
        in a reduced pair, and the refinement goes on at the images' own size; for images hardly larger than the reduced
        ones (by less than the factor LEAST_GAIN), the maps of these are enlarged instead.

        Args:
            left, right: (H, W) or (H, W, 3) uint8, RGB.
            rig: The cameras of these images.
            nearest: The shortest distance that should be measured [m]; None is 0.84 m.
            max_pixels: Largest number of pixels of an image that the network works on; larger images are reduced to
                it, which saves time and memory. None: as many as the images have.

        Returns:
            Depth in metres of the given rig; inf where the network sees sky. Where it sees sky and none can be (see
            m3depth/stereo/sky.py), and where its numbers are not finite, all maps are NaN and confidence is 0.

        Raises:
            ValueError: Images of a wrong type or size, or `nearest` or `max_pixels` is not positive.
        """
        if nearest is not None and not (math.isfinite(nearest) and nearest > 0):
            raise ValueError(f"nearest must be positive, got {nearest}")
        if max_pixels is not None and not max_pixels > 0:
            raise ValueError(f"max_pixels must be positive, got {max_pixels}")
        left, right = map(in_colour, checked_pair(left, right, rig))
        height, width = left.shape[:2]
        device = next(self.parameters()).device
        out: StereoOutput | None = None
        for rows, columns in self.sizes(rig, NEAREST if nearest is None else nearest, max_pixels):
            work, pair = rig, [left, right]
            if (rows, columns) != (height, width):
                work = rig.resized(columns, rows)
                pair = [np.asarray(cv2.resize(x, (columns, rows), interpolation=cv2.INTER_AREA)) for x in pair]
            images = torch.from_numpy(np.stack(pair)).to(device).permute(0, 3, 1, 2).float() / 255
            start = None if out is None else out.start(rows, columns)
            with autocast(device, fast_dtype(device)):
                out = self(images[:1], images[1:], camera_row(work, device), start)
        assert out is not None
        maps = torch.cat([out.disparity, out.normal, out.confidence.sigmoid(), out.sky], 1).float()  # (1, 6, h, w)
        if maps.shape[-2:] != (height, width):
            maps[:, 0] *= width / maps.shape[-1]
            maps = F.interpolate(maps, (height, width), mode="bilinear")
            rays = pixel_rays(camera_row(rig, device), height, width)
            maps[:, 1:4] = by_rows(
                facing_normals, maps[:, 1:4], rays
            )  # interpolation may turn a normal away from the camera
        known = maps[0].isfinite().all(0)
        taken = known & ((maps[0, 5] > 0) | (maps[0, 0] < MIN_DISPARITY))
        seen, found, sure = (x.cpu().numpy() for x in (taken, maps[0, 0], maps[0, 4]))
        sky = torch.from_numpy(possible_sky(seen, found, sure, rig.camera)).to(device)
        known &= sky | ~taken  # what looks like sky where none can be is unknown
        disparity = torch.where(sky, torch.zeros_like(maps[0, 0]), maps[0, 0])
        disparity = torch.where(known, disparity, torch.full_like(disparity, torch.nan))
        depth = disparity_to_depth(disparity, rig.fb)
        disparity = torch.where(depth.isinf(), torch.zeros_like(disparity), disparity)
        normal = torch.where(known, maps[0, 1:4], torch.full_like(maps[0, 1:4], torch.nan)).permute(1, 2, 0)
        confidence = torch.where(known, maps[0, 4], torch.zeros_like(disparity))
        arrays = [x.cpu().contiguous().numpy() for x in (depth, disparity, normal, confidence)]
        return Prediction(*arrays)


def facing_normals(normal: Tensor, rays: Tensor) -> Tensor:
    """Return normals (B, 3, H, W) with unit length and facing the camera, along rays (B, 3, H, W)."""
    return face_camera(unit(normal), rays)


def fitted(maps: Tensor, height: int, width: int) -> Tensor:
    """Cut maps (B, C, h, w) to (B, C, height, width), or repeat their last row and column up to it."""
    maps = maps[..., :height, :width]
    missing = (0, width - maps.shape[-1], 0, height - maps.shape[-2])
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


def camera_row(rig: StereoRig, device: torch.device) -> Tensor:
    """Return fx, fy, cx, cy [px] of a rig as forward takes them: (1, 4) float32.

    Args:
        rig: The cameras.
        device: Device of the row.
    """
    c = rig.camera
    return torch.tensor([[c.fx, c.fy, c.cx, c.cy]], dtype=torch.float32, device=device)
