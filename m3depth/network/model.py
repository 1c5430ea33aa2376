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

VOLUME_STEP = 8  # [px] disparity between two hypotheses: the volume stands at 1/8


class StereoOutput(NamedTuple):
    """What forward returns; all float32. Disparities are pixels of the full-size image, normals are of unit length.

    disparity: (B, 1, H, W). normal: (B, 3, H, W), facing the camera; the coarse ones need not. confidence, sky:
    (B, 1, H, W) logits of "within 1 px" and of "sky or beyond measure". initial: disparity and normal of soft argmin
    and SNNet, at 1/8 or on the grid of the output head. steps: disparity and normal at 1/4 after each refinement.
    """

    disparity: Tensor
    normal: Tensor
    confidence: Tensor
    sky: Tensor
    initial: tuple[Tensor, Tensor]
    steps: list[tuple[Tensor, Tensor]]


class M3Depth(nn.Module):
    """The network. `infer` takes images as they come; `forward` takes batches of tensors.

    recompute: activation checkpointing. While training, large parts keep their inputs only and are computed again on
    the way back: the same gradients with less memory, about a third slower.
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
        for layer in self.modules():  # twice as fast on a CPU; Module.to() would stumble over the 3-D convolutions
            if isinstance(layer, nn.Conv2d):
                layer.weight.data = layer.weight.data.contiguous(memory_format=torch.channels_last)

    @classmethod
    def from_preset(cls, name: str) -> M3Depth:
        """A new network, `lite` or `paper`, with random weights."""
        if name not in PRESETS:
            raise ValueError(f"preset {name!r} is not one of {', '.join(PRESETS)}")
        return cls(PRESETS[name])

    @classmethod
    def from_pretrained(cls, path: str | Path | None = None) -> M3Depth:
        """A trained network, in evaluation mode.

        path: a .safetensors file written by save_pretrained; None: the weights that come with the package. Raises
        FileNotFoundError if there is none, ValueError (one line that names the file) if it cannot be used.
        """
        source = SHIPPED_WEIGHTS if path is None else Path(path)
        config, tensors = load_weights(source)
        try:
            network = M3DepthConfig.from_dict(config)
            with torch.device("meta"):  # shapes alone: a config that lies about its sizes takes no memory
                expected = cls(network).state_dict()
        except ValueError as error:
            raise ValueError(f"{source}: {error}") from None
        wrong = sorted(expected.keys() ^ tensors.keys())
        wrong = wrong or sorted(k for k in expected if expected[k].shape != tensors[k].shape)
        if wrong:
            raise ValueError(f"{source}: {len(wrong)} tensors do not fit the network, the first is {wrong[0]!r}")
        model = cls(network)
        model.load_state_dict(tensors)
        return model.eval()

    def save_pretrained(self, path: str | Path) -> None:
        """Write weights (.safetensors) and, beside them, their config (.json). Replaces existing files atomically."""
        save_weights(Path(path), asdict(self.config), self.state_dict())

    def forward(self, left: Tensor, right: Tensor, camera: Tensor) -> StereoOutput:
        """left, right: (B, 3, H, W) float in [0, 1], rectified, any size. camera: (B, 4) fx, fy, cx, cy [px]."""
        height, width = left.shape[-2:]
        multiple = self.config.size_multiple
        padding = (0, -width % multiple, 0, -height % multiple)  # right and bottom: the principal point stays
        if any(padding):
            left, right = (F.pad(image, padding, mode="replicate") for image in (left, right))
        camera = camera.float()
        # One mean and contrast for both eyes: low contrast then looks like high contrast, gains between eyes remain.
        mean = left.mean((1, 2, 3), keepdim=True)
        scale = left.std((1, 2, 3), keepdim=True).clamp(min=0.01)
        images = (torch.cat([left, right]) - torch.cat([mean, mean])) / torch.cat([scale, scale])
        part = recomputed if self.recompute and torch.is_grad_enabled() else direct
        features = part(self.backbone, images.contiguous(memory_format=torch.channels_last))
        left4, right4 = features.quarter.chunk(2)
        left8 = features.eighth.chunk(2)[0]

        matched = features.eighth if self.match is None else self.match(features.eighth)
        match_left, match_right = matchable(matched.float().contiguous()).chunk(2)
        volume = group_correlation_volume(match_left, match_right, self.config.hypotheses, self.config.groups)
        volume, scores, context = part(self.aggregation, volume, left8)
        cell = VOLUME_STEP >> self.config.output_head  # [px] of the grid on which the volume now stands
        disparity = soft_argmin(scores.float(), VOLUME_STEP)
        rays = pixel_rays(scale_camera(camera, cell), images.shape[-2] // cell, images.shape[-1] // cell)
        normal = part(self.normals, volume, left8, rays)
        initial = (disparity, normal)

        if context is not None:
            left8 = torch.cat([left8, resize(context, left8.shape[-2:])], 1)
        steps: list[tuple[Tensor, Tensor]] = []
        if self.refinement is not None:
            disparity, normal = (resize(x, left4.shape[-2:]) for x in initial)
            camera4 = scale_camera(camera, 4)
            steps, fine, hidden = self.refinement(left4, right4, left8, disparity, unit(normal), camera4, part)
            if self.fine is not None:
                fine = fine + part(self.fine, *features.half.chunk(2), hidden, fine, camera)
        else:
            assert self.decisions is not None
            maps = (disparity, normal, self.decisions(left8).float())
            fine = torch.cat([resize(x, images.shape[-2:]) for x in maps], 1)
        fine = fine[..., :height, :width]
        normal = face_camera(unit(fine[:, 1:4]), pixel_rays(camera, height, width))
        initial = unpadded(initial, height, width, cell)
        steps = [unpadded(step, height, width, 4) for step in steps]
        return StereoOutput(fine[:, :1], normal, fine[:, 4:5], fine[:, 5:6], initial, steps)

    @property
    def reach(self) -> int:
        """Disparities [px] end here; images in which more is needed are reduced by infer."""
        return VOLUME_STEP * self.config.hypotheses

    @torch.inference_mode()
    def infer(self, left: np.ndarray, right: np.ndarray, rig: StereoRig, nearest: float | None = None) -> Prediction:
        """Depth, disparity, normals and confidence of one rectified pair, at the input's size.

        left, right: (H, W) or (H, W, 3) uint8, RGB. rig: the cameras of these images. nearest [m]: what should still
        be measured, 0.84 m by default; images in which that is a larger disparity than the network's hypotheses reach
        (192 px) are reduced first, as those of rigs whose f B exceeds NaTeCam's. Depth is in metres of the given rig,
        inf where the network sees sky; where its numbers are none, all is NaN and confidence 0. Raises ValueError for
        wrong types or sizes, and where nearest is not positive.
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
        maps = torch.cat([out.disparity, out.normal, out.confidence.sigmoid(), out.sky], 1).float()
        if work is not rig:
            maps = F.interpolate(maps, (height, width), mode="bilinear")
            maps[:, 0] *= width / work.camera.width
            rays = pixel_rays(camera_row(rig, device), height, width)
            maps[:, 1:4] = face_camera(unit(maps[:, 1:4]), rays)  # a mean of normals that face it need not
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
    """Disparity and normal on a grid of `cell` px, without the cells that lie beyond an image of height x width."""
    first, second = (x[..., : -(-height // cell), : -(-width // cell)] for x in maps)
    return first, second


def camera_row(rig: StereoRig, device: torch.device) -> Tensor:
    """(1, 4) float32 fx, fy, cx, cy [px], as forward takes it."""
    c = rig.camera
    return torch.tensor([[c.fx, c.fy, c.cx, c.cy]], dtype=torch.float32, device=device)
