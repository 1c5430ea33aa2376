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

from m3depth.network.backbone import Backbone
from m3depth.network.checkpointing import direct, recomputed
from m3depth.network.config import PRESETS, M3DepthConfig
from m3depth.network.cost_volume import Aggregation, group_correlation_volume, matchable, soft_argmin
from m3depth.network.device import autocast, fast_dtype
from m3depth.network.fine_correction import FineCorrection
from m3depth.network.geometry import disparity_to_depth, face_camera, pixel_rays, resize, scale_camera, unit
from m3depth.network.normal_branch import SNNet
from m3depth.network.refinement import Refinement
from m3depth.network.weights_file import load_weights, save_weights
from m3depth.stereo.pairs import NEAREST, checked_pair, in_colour
from m3depth.stereo.prediction import Prediction
from m3depth.weights import SHIPPED_WEIGHTS
from marssim.base.camera import StereoRig

VOLUME_STEP = 8  # [px] disparity between two hypotheses: a cell of the volume, which is at 1/8


class StereoOutput(NamedTuple):
    """What forward returns, all float32. Disparities are pixels of the full-size image, normals have unit length.

    Attributes:
        disparity: (B, 1, H, W) [px].
        normal: (B, 3, H, W), facing the camera.
        confidence: (B, 1, H, W), logit of "the disparity is within 1 px".
        sky: (B, 1, H, W), logit of "sky or too far to measure".
        initial: Disparity and normal of soft argmin and SNNet, at 1/8 or on the grid of the output head.
        steps: Disparity and normal at 1/4 after each refinement step. These normals, and the initial ones, may point
            away from the camera.
    """

    disparity: Tensor
    normal: Tensor
    confidence: Tensor
    sky: Tensor
    initial: tuple[Tensor, Tensor]
    steps: list[tuple[Tensor, Tensor]]


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

    def forward(self, left: Tensor, right: Tensor, camera: Tensor) -> StereoOutput:
        """Run the network on a batch.

        Args:
            left, right: (B, 3, H, W) float in [0, 1], rectified, of any size.
            camera: (B, 4) fx, fy, cx, cy [px].
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
        left4, right4 = features.quarter.chunk(2)  # (B, C4, H / 4, W / 4)
        left8 = features.eighth.chunk(2)[0]  # (B, C8, H / 8, W / 8)

        matched = features.eighth if self.match is None else self.match(features.eighth)
        match_left, match_right = matchable(matched.float().contiguous()).chunk(2)
        volume = group_correlation_volume(match_left, match_right, self.config.hypotheses, self.config.groups)
        # From (B, groups, D, H / 8, W / 8) to the grid of `cell` px, which is finer with an output head.
        volume, scores, context = call(self.aggregation, volume, left8)
        cell = VOLUME_STEP >> self.config.output_head
        disparity = soft_argmin(scores.float(), VOLUME_STEP)  # (B, 1, H / cell, W / cell)
        rays = pixel_rays(scale_camera(camera, cell), images.shape[-2] // cell, images.shape[-1] // cell)
        normal = call(self.normals, volume, left8, rays)  # (B, 3, H / cell, W / cell)
        initial = (disparity, normal)

        if context is not None:
            left8 = torch.cat([left8, resize(context, left8.shape[-2:])], 1)  # (B, coarse_width, H / 8, W / 8)
        steps: list[tuple[Tensor, Tensor]] = []
        if self.refinement is not None:
            disparity, normal = (resize(x, left4.shape[-2:]) for x in initial)
            camera4 = scale_camera(camera, 4)
            steps, maps, hidden = self.refinement(left4, right4, left8, disparity, unit(normal), camera4, call)
            if self.fine is not None:
                maps = maps + call(self.fine, *features.half.chunk(2), hidden, maps, camera)
        else:
            assert self.decisions is not None
            coarse = (disparity, normal, self.decisions(left8).float())
            maps = torch.cat([resize(x, images.shape[-2:]) for x in coarse], 1)
        maps = maps[..., :height, :width]  # (B, 6, H, W): disparity, normal, confidence, sky
        normal = face_camera(unit(maps[:, 1:4]), pixel_rays(camera, height, width))
        initial = unpadded(initial, height, width, cell)
        steps = [unpadded(step, height, width, 4) for step in steps]
        return StereoOutput(maps[:, :1], normal, maps[:, 4:5], maps[:, 5:6], initial, steps)

    @property
    def reach(self) -> int:
        """The disparity at which the hypotheses end [px]; `infer` reduces images that need more."""
        return VOLUME_STEP * self.config.hypotheses

    @torch.inference_mode()
    def infer(self, left: np.ndarray, right: np.ndarray, rig: StereoRig, nearest: float | None = None) -> Prediction:
        """Estimate depth, disparity, normals and confidence of one rectified pair, at the input's size.

        Images of a rig in which `nearest` is a larger disparity than the hypotheses reach (192 px) are reduced first.
        This concerns rigs whose f B exceeds NaTeCam's.

        Args:
            left, right: (H, W) or (H, W, 3) uint8, RGB.
            rig: The cameras of these images.
            nearest: The shortest distance that should be measured [m]; None is 0.84 m.

        Returns:
            Depth in metres of the given rig; inf where the network sees sky. Where the network's numbers are not
            finite, all maps are NaN and confidence is 0.

        Raises:
            ValueError: Images of a wrong type or size, or `nearest` is not positive.
        """
        if nearest is not None and not (math.isfinite(nearest) and nearest > 0):
            raise ValueError(f"nearest must be positive, got {nearest}")
        left, right = map(in_colour, checked_pair(left, right, rig))
        height, width = left.shape[:2]
        needed = rig.fb / (NEAREST if nearest is None else nearest)
        scale = min(1.0, self.reach / needed)
        work = rig
        if scale < 0.99:
            work = rig.resized(max(1, round(width * scale)), max(1, round(height * scale)))
            size = (work.camera.width, work.camera.height)
            left, right = (cv2.resize(image, size, interpolation=cv2.INTER_AREA) for image in (left, right))
        device = next(self.parameters()).device
        pair = torch.from_numpy(np.stack([left, right])).to(device).permute(0, 3, 1, 2).float() / 255
        with autocast(device, fast_dtype(device)):
            out = self(pair[:1], pair[1:], camera_row(work, device))
        maps = torch.cat([out.disparity, out.normal, out.confidence.sigmoid(), out.sky], 1).float()  # (1, 6, h, w)
        if work is not rig:
            maps = F.interpolate(maps, (height, width), mode="bilinear")
            maps[:, 0] *= width / work.camera.width
            rays = pixel_rays(camera_row(rig, device), height, width)
            maps[:, 1:4] = face_camera(unit(maps[:, 1:4]), rays)  # interpolation may turn a normal away from the camera
        known = maps[0].isfinite().all(0)
        disparity = torch.where(maps[0, 5] > 0, torch.zeros_like(maps[0, 0]), maps[0, 0])
        disparity = torch.where(known, disparity, torch.full_like(disparity, torch.nan))
        depth = disparity_to_depth(disparity, rig.fb)
        disparity = torch.where(depth.isinf(), torch.zeros_like(disparity), disparity)
        normal = torch.where(known, maps[0, 1:4], torch.full_like(maps[0, 1:4], torch.nan)).permute(1, 2, 0)
        confidence = torch.where(known, maps[0, 4], torch.zeros_like(disparity))
        arrays = [x.cpu().contiguous().numpy() for x in (depth, disparity, normal, confidence)]
        return Prediction(*arrays)


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
