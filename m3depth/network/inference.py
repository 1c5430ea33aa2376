"""From a pair of any size to the sizes at which the network works, and from its maps to a Prediction."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from m3depth.network.config import FARTHEST_STEP
from m3depth.network.geometry import MIN_DISPARITY, disparity_to_depth, facing_normals, pixel_rays
from m3depth.network.output import Maps, Start
from m3depth.network.row_bands import by_rows
from m3depth.stereo.pairs import NEAREST, checked_pair, in_colour
from m3depth.stereo.prediction import Prediction
from m3depth.stereo.sky import possible_sky
from marssim.base.camera import StereoRig

LEAST_GAIN = 1.2  # factor from which the refinement goes on at a larger size
SAME = 1.01  # factor up to which two sizes are one
ROUNDING = 1e-6  # of the number of sizes, which is that of whole steps

Forward = Callable[[Tensor, Tensor, Tensor, Start | None], Any]
"""A way to run a network: it takes and returns what its forward does, Maps; a Start only where the network goes on."""


def infer_pair(
    forward: Forward, reach: float, goes_on: bool, device: torch.device, left: np.ndarray, right: np.ndarray,
    rig: StereoRig, nearest: float | None = None, max_pixels: int | None = None,
) -> Prediction:  # fmt: skip
    """Run a network on a pair, from coarse to fine, and return its maps; StereoNetwork.infer describes the result.

    Args:
        forward: Runs the network.
        reach: Disparity at which the network's search ends [px].
        goes_on: Whether the network goes on at the images' own size where a reduced pair ended.
        device: Where `forward` takes its tensors.
        left: (H, W) or (H, W, 3) uint8, RGB.
        right: The right image, of the same shape.
        rig: The cameras of these images.
        nearest: The shortest distance that should be measured [m]; None is 0.84 m.
        max_pixels: Largest number of pixels of an image that the network works on; None: as many as the images have.

    Raises:
        ValueError: Images of a wrong type or size, or `nearest` or `max_pixels` is not positive.
    """
    if nearest is not None and not (math.isfinite(nearest) and nearest > 0):
        raise ValueError(f"nearest must be positive, got {nearest}")
    if max_pixels is not None and not max_pixels > 0:
        raise ValueError(f"max_pixels must be positive, got {max_pixels}")
    left, right = map(in_colour, checked_pair(left, right, rig))
    height, width = left.shape[:2]
    nearest = NEAREST if nearest is None else nearest
    out: Any = None
    for rows, columns in working_sizes(rig, reach, nearest, max_pixels, goes_on):
        work, pair = rig, [left, right]
        if (rows, columns) != (height, width):
            work = rig.resized(columns, rows)
            pair = [np.asarray(cv2.resize(x, (columns, rows), interpolation=cv2.INTER_AREA)) for x in pair]
        images = torch.from_numpy(np.stack(pair)).to(device).permute(0, 3, 1, 2).float() / 255
        start = None if out is None else out.start(rows, columns)
        out = forward(images[:1], images[1:], camera_row(work, device), start)
    return prediction_of(out, rig)


def working_sizes(
    rig: StereoRig, reach: float, nearest: float, max_pixels: int | None = None, refines: bool = True
) -> list[tuple[int, int]]:
    """Return the heights and widths [px] at which the network works on a pair, from coarse to fine.

    The cost volume works at the first, where `nearest` is within its reach, and the refinement goes on at each of the
    others, at most FARTHEST_STEP times as large as the one before.

    Args:
        rig: The cameras of the images.
        reach: Disparity at which the hypotheses end [px].
        nearest: Shortest distance [m] that the cost volume should find.
        max_pixels: Largest number of pixels; None: those of the images.
        refines: Whether the network has a refinement; without one it works at one size.
    """
    height, width = rig.camera.height, rig.camera.width
    finest = 1.0 if max_pixels is None else min(1.0, math.sqrt(max_pixels / (height * width)))
    first = min(finest, reach * nearest / rig.fb)
    gain = finest / first
    first = finest if gain < SAME else first
    more = math.ceil(math.log(gain, FARTHEST_STEP) - ROUNDING) if gain >= LEAST_GAIN and refines else 0
    scales = [first * gain ** (k / more) for k in range(1, more)] + [finest] * (more > 0)
    return [(max(1, round(height * scale)), max(1, round(width * scale))) for scale in (first, *scales)]


def prediction_of(out: Maps, rig: StereoRig) -> Prediction:
    """Return the maps of one pair, (1, C, h, w), as a Prediction of the rig's size.

    Args:
        out: What the network returned, at its last size. Without a confidence, it is 1 where depth is known; without a
            map of the sky, the sky is where the disparity ends.
        rig: The cameras of the pair.
    """
    height, width, device = rig.camera.height, rig.camera.width, out.disparity.device
    normal = torch.zeros_like(out.disparity).expand(-1, 3, -1, -1) if out.normal is None else out.normal
    certain = torch.ones_like(out.disparity) if out.confidence is None else out.confidence.sigmoid()
    sky_logit = torch.full_like(out.disparity, -1.0) if out.sky is None else out.sky
    maps = torch.cat([out.disparity, normal, certain, sky_logit], 1).float()  # (1, 6, h, w)
    if maps.shape[-2:] != (height, width):
        maps[:, 0] *= width / maps.shape[-1]
        maps = F.interpolate(maps, (height, width), mode="bilinear")
        # interpolation may turn a normal away from the camera
        rays = pixel_rays(camera_row(rig, device), height, width)
        maps[:, 1:4] = by_rows(facing_normals, maps[:, 1:4], rays)
    known = maps[0].isfinite().all(0)
    candidates = known & ((maps[0, 5] > 0) | (maps[0, 0] < MIN_DISPARITY))
    candidate_map, disparity_map, confidence_map = (x.cpu().numpy() for x in (candidates, maps[0, 0], maps[0, 4]))
    sky = torch.from_numpy(possible_sky(candidate_map, disparity_map, confidence_map, rig.camera)).to(device)
    known &= sky | (maps[0, 0] >= MIN_DISPARITY)  # where no sky can be, nothing is as far
    disparity = torch.where(sky, torch.zeros_like(maps[0, 0]), maps[0, 0])
    disparity = torch.where(known, disparity, torch.full_like(disparity, torch.nan))
    depth = disparity_to_depth(disparity, rig.fb)
    disparity = torch.where(depth.isinf(), torch.zeros_like(disparity), disparity)
    normal = torch.where(known, maps[0, 1:4], torch.full_like(maps[0, 1:4], torch.nan)).permute(1, 2, 0)
    confidence = torch.where(known, maps[0, 4], torch.zeros_like(disparity))
    arrays = [x.cpu().contiguous().numpy() for x in (depth, disparity, normal, confidence)]
    return Prediction(arrays[0], arrays[1], None if out.normal is None else arrays[2], arrays[3])


def camera_row(rig: StereoRig, device: torch.device) -> Tensor:
    """Return fx, fy, cx, cy [px] of a rig as forward takes them: (1, 4) float32.

    Args:
        rig: The cameras.
        device: Device of the row.
    """
    c = rig.camera
    return torch.tensor([[c.fx, c.fy, c.cx, c.cy]], dtype=torch.float32, device=device)
