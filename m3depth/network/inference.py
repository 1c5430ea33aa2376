"""From a pair of any size to the sizes at which the network works, and from its maps to a Prediction."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
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
from m3depth.stereo.pairs import LEAST_PIXELS, NEAREST, TINY, checked_pair, in_colour, largest_disparity
from m3depth.stereo.prediction import Prediction
from m3depth.stereo.rows import align_rows
from m3depth.stereo.sky import possible_sky
from marssim.base.camera import StereoRig

LEAST_GAIN = 1.2  # factor from which the refinement goes on at a larger size
SAME = 1.01  # factor up to which two sizes are one
ROUNDING = 1e-6  # of the number of sizes, which is that of whole steps

Forward = Callable[[Tensor, Tensor, Tensor, Start | None], Any]
"""A way to run a network: it takes and returns what its forward does, Maps; a Start only where the network goes on."""


def infer_pair(
    forward: Forward, reach: float, goes_on: bool, device: torch.device, left: np.ndarray, right: np.ndarray,
    rig: StereoRig, nearest: float | None = None, max_pixels: int | None = None, align: bool = False,
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
        align: Whether rows of the images that lie significantly apart are aligned first.

    Raises:
        ValueError: Images of a wrong type or size, `nearest` is not positive, or `max_pixels` is below 2048.
    """
    if nearest is not None and not (math.isfinite(nearest) and nearest > 0):
        raise ValueError(f"nearest must be positive, got {nearest}")
    if max_pixels is not None and not max_pixels >= LEAST_PIXELS:
        raise ValueError(f"max_pixels must be at least {LEAST_PIXELS}, got {max_pixels}")
    left, right = checked_pair(left, right, rig)
    right, rows_fit = align_rows(left, right, rig) if align else (right, None)
    height, width = left.shape[:2]
    if (whole := padded_rig(rig)) is not rig:
        rig, max_pixels = whole, None  # no fewer pixels than the image has
    missing = 0, rig.camera.height - height, 0, rig.camera.width - width
    pair = [cv2.copyMakeBorder(in_colour(x), *missing, cv2.BORDER_REPLICATE) for x in (left, right)]
    nearest = NEAREST if nearest is None else nearest
    out: Any = None
    for rows, columns in working_sizes(rig, reach, nearest, max_pixels, goes_on):
        out = _run_at_size(forward, device, pair, rig, rows, columns, out)
    made = prediction_of(out, rig)
    depth, disparity, normal, confidence = (
        None if x is None else x[:height, :width] for x in (made.depth, made.disparity, made.normal, made.confidence)
    )
    assert depth is not None and disparity is not None and confidence is not None
    return Prediction(depth, disparity, normal, confidence, rows_fit)


def padded_rig(rig: StereoRig) -> StereoRig:
    """Return the cameras of a pair after tiny images are padded below and at the right; `rig` if they are not tiny."""
    if max(rig.camera.height, rig.camera.width) > TINY:
        return rig
    return replace(rig, camera=replace(rig.camera, height=2 * TINY, width=2 * TINY))


def _run_at_size(
    forward: Forward, device: torch.device, pair: Sequence[np.ndarray], rig: StereoRig, rows: int, columns: int,
    coarse: Any,
) -> Any:  # fmt: skip
    """Return the maps of a pair at one of its working sizes; coarse: those of the size before, None at the first."""
    work = rig
    if (rows, columns) != pair[0].shape[:2]:
        work = rig.resized(columns, rows)
        pair = [np.asarray(cv2.resize(x, (columns, rows), interpolation=cv2.INTER_AREA)) for x in pair]
    images = torch.from_numpy(np.stack(pair)).to(device).permute(0, 3, 1, 2).float().div_(255)
    start = None if coarse is None else coarse.start(rows, columns)
    return forward(images[:1], images[1:], camera_row(work, device), start)


def working_sizes(
    rig: StereoRig, reach: float, nearest: float, max_pixels: int | None = None, refines: bool = True
) -> list[tuple[int, int]]:
    """Return the heights and widths [px] at which the network works on a pair, from coarse to fine.

    The cost volume works at the first, where the disparity of `nearest`, or one of the images' width, is within its
    reach, and the refinement goes on at each of the others, at most FARTHEST_STEP times as large as the one before.

    Args:
        rig: The cameras of the images.
        reach: Disparity at which the hypotheses end [px].
        nearest: Shortest distance [m] that the cost volume should find.
        max_pixels: Largest number of pixels; None: those of the images.
        refines: Whether the network has a refinement; without one it works at one size.
    """
    height, width = rig.camera.height, rig.camera.width
    finest = 1.0 if max_pixels is None else min(1.0, math.sqrt(max_pixels / (height * width)))
    first = min(finest, reach / largest_disparity(rig, nearest))
    gain = finest / first
    first = finest if gain < SAME else first
    more = math.ceil(math.log(gain, FARTHEST_STEP) - ROUNDING) if gain >= LEAST_GAIN and refines else 0
    scales = [first * gain ** (k / more) for k in range(1, more)] + [finest] * (more > 0)
    sizes = [(max(1, round(height * scale)), max(1, round(width * scale))) for scale in (first, *scales)]
    if max_pixels is None or sizes[-1][0] * sizes[-1][1] <= max_pixels:
        return sizes
    return [*sizes[:-1], (max(1, int(height * finest)), max(1, int(width * finest)))]


def prediction_of(out: Maps, rig: StereoRig) -> Prediction:
    """Return the maps of one pair, (1, C, h, w), as a Prediction of the rig's size.

    The confidence c of being right within 1 px of a smaller image becomes 1 - (1 - c)^(1 / factor), that of 1 px of the
    rig's image if errors are distributed exponentially.

    Args:
        out: What the network returned, at its last size. Without a confidence, it is 1 where depth is known; without a
            map of the sky, the sky is where the disparity ends.
        rig: The cameras of the pair.
    """
    size = rig.camera.height, rig.camera.width
    disparity, normal, certain, sky_logit = (
        None if x is None else x.float() for x in (out.disparity, out.normal, out.confidence, out.sky)
    )
    assert disparity is not None
    certain = torch.ones_like(disparity) if certain is None else certain.sigmoid()
    factor = size[1] / disparity.shape[-1]
    if resized := disparity.shape[-2:] != size:
        disparity, normal, certain, sky_logit = (
            None if x is None else F.interpolate(x, size, mode="bilinear")
            for x in (disparity * factor, normal, certain, sky_logit)
        )
        if normal is not None:  # interpolation may turn one away from the camera
            normal = by_rows(facing_normals, normal, pixel_rays(camera_row(rig, normal.device), *size))
    assert disparity is not None and certain is not None
    disparity, certain = disparity[0, 0], certain[0, 0]
    valid = disparity.isfinite() & certain.isfinite()
    if normal is not None:
        valid &= normal[0].isfinite().all(0)
    candidates = disparity < MIN_DISPARITY
    if sky_logit is not None:
        valid &= sky_logit[0, 0].isfinite()
        candidates |= sky_logit[0, 0] > 0
    may_be, far, sure = (x.cpu().numpy() for x in (candidates & valid, disparity, certain))
    sky = torch.from_numpy(possible_sky(may_be, far, sure, rig)).to(disparity.device)
    valid &= sky | (disparity >= MIN_DISPARITY)  # where no sky can be, nothing is as far
    disparity = disparity.masked_fill(sky, 0.0).masked_fill_(~valid, torch.nan)
    depth = disparity_to_depth(disparity, rig.fb)
    disparity.masked_fill_(depth.isinf(), 0.0)
    if resized:
        certain = 1 - (1 - certain) ** (1 / factor)
    certain = certain.masked_fill(~valid, 0.0)
    if normal is not None:
        normal = normal[0].permute(1, 2, 0).contiguous().masked_fill_(~valid[..., None], torch.nan)
    depth_map, disparity_map, certain_map = (x.cpu().numpy() for x in (depth, disparity, certain))
    return Prediction(depth_map, disparity_map, None if normal is None else normal.cpu().numpy(), certain_map)


def camera_row(rig: StereoRig, device: torch.device) -> Tensor:
    """Return fx, fy, cx, cy [px] of a rig as forward takes them: (1, 4) float32.

    Args:
        rig: The cameras.
        device: Device of the row.
    """
    c = rig.camera
    return torch.tensor([[c.fx, c.fy, c.cx, c.cy]], dtype=torch.float32, device=device)
