"""Stereo samples to training batches: packing, caching, crops, augmentation.

Every batch is a function of (seed, step, rank) alone, so that a run that was stopped goes on with the same batches.
"""

from __future__ import annotations

import math
import os
import threading
from collections import deque
from collections.abc import Generator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import cv2
import numpy as np
import torch
from torch import Tensor

from m3depth.losses import Target
from m3depth.pairs import MAX_DISPARITY, StereoPairs
from marssim.camera import NATECAM

FARTHEST = 40.0  # [m] trained although only 15 m are scored: what is farther tells far ground from sky
LEAST_DISPARITY = NATECAM.fb / FARTHEST  # [px] that is 4 px; rigs that see more at 40 m are trained as far as that
DISPARITY_UNIT = 1 / 256  # [px] of the packed disparities


class PackedSample(NamedTuple):
    """A sample in a seventh of its memory, about 3.4 MB at 512 x 512.

    left, right: (H, W, 3) uint8. disparity: (H, W) uint16, in DISPARITY_UNIT. normal: (H, W, 3) int8, 127 is 1.
    flags: (H, W) uint8, bit 0 trained, bit 1 sky, bit 2 rock, bit 3 scored. camera: fx, fy, cx, cy.
    """

    left: np.ndarray
    right: np.ndarray
    disparity: np.ndarray
    normal: np.ndarray
    flags: np.ndarray
    camera: tuple[float, float, float, float]

    @property
    def nbytes(self) -> int:
        return sum(a.nbytes for a in self[:5])


class Batch(NamedTuple):
    """left, right: (B, 3, H, W) float32 in [0, 1]; what they show: target."""

    left: Tensor
    right: Tensor
    target: Target

    def to(self, device: torch.device) -> Batch:
        """The batch on another device."""
        move = [x.to(device, non_blocking=True) for x in self.target]
        return Batch(self.left.to(device, non_blocking=True), self.right.to(device, non_blocking=True), Target(*move))


@dataclass(frozen=True)
class AugmentConfig:
    """Chances are per crop; every draw comes from the batch's own generator.

    Raises ValueError that names the flag of a value that cannot work.
    """

    contrast: float = 0.34  # contrast is scaled down to this share, log-uniformly, up to 1.25; 1: not changed
    brightness: float = 0.12  # shift, of the full range
    gamma: float = 0.25  # exponent exp(+- this)
    eye_gain: float = 0.08  # gain of the right eye relative to the left one, 1 +- this
    noise: float = 0.02  # highest standard deviation, of the full range; drawn for half of the crops
    blur: float = 1.0  # highest sigma [px] of a Gaussian, a third of the crops; 0: none
    grey: float = 0.3  # chance that colour is dropped
    vertical: float = 0.5  # largest vertical offset of the right image [px], half of the crops
    occlude: float = 0.25  # chance of patches in the right image that show nothing of the left
    bottom: float = 0.35  # chance that the crop touches the lower edge, where disparities are largest

    def __post_init__(self) -> None:
        limits = {"contrast": 1.0, "brightness": 1.0, "grey": 1.0, "occlude": 1.0, "bottom": 1.0}
        for name, value in asdict(self).items():
            highest = limits.get(name, math.inf)
            if not (math.isfinite(value) and 0 <= value <= highest):
                expected = "at least 0" if highest == math.inf else f"0 to {highest:g}"
                raise ValueError(f"--augment.{name.replace('_', '-')} must be {expected}, got {value}")
        if self.contrast == 0:
            raise ValueError("--augment.contrast must be over 0; 1 leaves the contrast as it is")


def pack(sample: Any) -> PackedSample:
    """Pack a sample of marssim.dataset, or any object with its fields.

    Depth that is infinite is sky; what is NaN is unknown and not trained. A normal of length 0 is unknown: depth is
    trained there alone.
    """
    disparity = np.asarray(sample.disparity, np.float32)
    depth = np.asarray(sample.depth)
    sky = np.isposinf(depth)
    near = (depth < FARTHEST) | (disparity > LEAST_DISPARITY)
    trained = near & (depth > 0) & (disparity > 0) & (disparity <= MAX_DISPARITY)
    normal = np.asarray(sample.normal)
    rock = np.asarray(sample.rock) > 0
    scored = trained & np.asarray(sample.valid)
    flags = trained * np.uint8(1) | sky * np.uint8(2) | rock * np.uint8(4) | scored * np.uint8(8)
    # What lies beyond FARTHEST is neither trained nor sky; its disparity is kept for the edges.
    stored = np.where(np.isfinite(disparity), disparity, 0) / DISPARITY_UNIT
    c = sample.rig.camera
    return PackedSample(
        np.ascontiguousarray(sample.left),
        np.ascontiguousarray(sample.right),
        stored.round().clip(0, 65535).astype(np.uint16),
        (np.nan_to_num(normal) * 127).round().astype(np.int8),
        flags.astype(np.uint8),
        (c.fx, c.fy, c.cx, c.cy),
    )


class Joined:
    """Several sequences of samples as one, in their order."""

    def __init__(self, parts: Sequence[StereoPairs]) -> None:
        self.parts = parts

    def __len__(self) -> int:
        return sum(map(len, self.parts))

    def __getitem__(self, index: int) -> Any:
        for part in self.parts:
            if index < len(part):
                return part[index]
            index -= len(part)
        raise IndexError(f"there are {len(self)} samples only")


class PackedCache:
    """Packed samples by index, kept in memory as long as they fit. Safe to read from several threads."""

    def __init__(self, samples: StereoPairs, limit_bytes: int) -> None:
        self.samples = samples
        self.limit = limit_bytes
        self.used = 0
        self._kept: dict[int, PackedSample] = {}
        self._lock = threading.Lock()

    def __len__(self) -> int:
        return len(self.samples)

    def __getitem__(self, index: int) -> PackedSample:
        kept = self._kept.get(index)
        if kept is not None:
            return kept
        packed = pack(self.samples[index])
        with self._lock:
            if index not in self._kept and self.used + packed.nbytes <= self.limit:
                self._kept[index] = packed
                self.used += packed.nbytes
        return packed


def free_memory() -> int:
    """Bytes of main memory that are free now; 2 GB where the system does not say."""
    try:
        return os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (ValueError, OSError, AttributeError):
        return 2 << 30


def sample_index(count: int, position: int, seed: int) -> int:
    """Which sample stands at a position of the endless, shuffled sequence of epochs."""
    epoch, place = divmod(position, count)
    return int(np.random.default_rng((seed, 1, epoch)).permutation(count)[place])


def crop(sample: PackedSample, y: int, x: int, height: int, width: int) -> PackedSample:
    """The part whose upper left pixel is (x, y); the principal point moves with it."""
    window = np.s_[y : y + height, x : x + width]
    fx, fy, cx, cy = sample.camera
    left, right, disparity, normal, flags = (a[window] for a in sample[:5])
    return PackedSample(left, right, disparity, normal, flags, (fx, fy, cx - x, cy - y))


def random_crop(sample: PackedSample, size: tuple[int, int], bottom: float, rng: np.random.Generator) -> PackedSample:
    """A crop of size (height, width). Raises ValueError if the images are smaller."""
    height, width = sample.left.shape[:2]
    spare_y, spare_x = height - size[0], width - size[1]
    if min(spare_y, spare_x) < 0:
        raise ValueError(f"--crop {size[0]} {size[1]} is larger than the images, {height} x {width}")
    y = spare_y if rng.random() < bottom else int(rng.integers(spare_y + 1))
    return crop(sample, y, int(rng.integers(spare_x + 1)), *size)


def augment(
    left: np.ndarray, right: np.ndarray, config: AugmentConfig, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Change how a pair looks, never what it shows. left, right: (H, W, 3) uint8; returns float32 in [0, 1]."""
    highest = min(1.25, 1 / config.contrast)
    log_contrast = rng.uniform(np.log(config.contrast), np.log(highest)) if rng.random() < 0.6 else 0.0
    gamma = np.exp(rng.uniform(-config.gamma, config.gamma))
    shift = rng.uniform(-config.brightness, config.brightness)
    middle = float(left[::8, ::8].mean()) / 255
    grey = rng.random() < config.grey
    sigma = rng.uniform(min(0.3, config.blur), config.blur) if rng.random() < 1 / 3 else 0.0
    noise = rng.uniform(0, config.noise) if rng.random() < 0.5 else 0.0
    levels = np.linspace(0, 1, 256) ** gamma
    eyes = []
    for image, gain in ((left, 1.0), (right, 1 + rng.uniform(-config.eye_gain, config.eye_gain))):
        table = ((levels - middle**gamma) * np.exp(log_contrast) + middle**gamma + shift) * gain
        eye = cv2.LUT(np.ascontiguousarray(image), table.clip(0, 1).astype(np.float32))
        if grey:
            eye = cv2.cvtColor(cv2.cvtColor(eye, cv2.COLOR_RGB2GRAY), cv2.COLOR_GRAY2RGB)
        if sigma:
            eye = cv2.GaussianBlur(eye, (0, 0), sigma)
        eyes.append(eye)
    left, right = eyes
    if rng.random() < 0.5 and config.vertical:
        move = np.array([[1, 0, 0], [0, 1, rng.uniform(-config.vertical, config.vertical)]])
        right = cv2.warpAffine(right, move, right.shape[1::-1], borderMode=cv2.BORDER_REPLICATE)
    if rng.random() < config.occlude:
        height, width = right.shape[:2]
        for _ in range(rng.integers(1, 3)):
            h, w = (int(rng.integers(max(2, s // 16), max(3, s // 4))) for s in (height, width))
            y, x = int(rng.integers(height - h)), int(rng.integers(width - w))
            right[y : y + h, x : x + w] = right[::8, ::8].mean((0, 1))
    if noise:
        left, right = (
            (eye + noise * rng.standard_normal(eye.shape, dtype=np.float32)).clip(0, 1) for eye in (left, right)
        )
    return left, right


def to_batch(items: Sequence[tuple[np.ndarray, np.ndarray, PackedSample]]) -> Batch:
    """Stack (left, right, packed ground truth) triples of one size."""

    def stack(arrays: list[np.ndarray]) -> Tensor:
        stacked = torch.from_numpy(np.stack(arrays))
        return stacked.permute(0, 3, 1, 2) if stacked.ndim == 4 else stacked[:, None]

    truths = [truth for _, _, truth in items]
    flags = stack([t.flags for t in truths])
    normal = stack([t.normal for t in truths]).float()
    target = Target(
        stack([t.disparity.astype(np.float32) for t in truths]) * DISPARITY_UNIT,
        normal * normal.square().sum(1, keepdim=True).clamp(min=1).rsqrt(),
        (flags & 1) > 0,
        (flags & 2) > 0,
        (flags & 4) > 0,
        torch.tensor([t.camera for t in truths], dtype=torch.float32),
    )
    return Batch(stack([left for left, _, _ in items]), stack([right for _, right, _ in items]), target)


def make_batch(
    cache: PackedCache, step: int, size: int, crop_size: tuple[int, int], config: AugmentConfig, seed: int,
    rank: int = 0, world: int = 1,
) -> Batch:  # fmt: skip
    """The augmented training batch of one step and process."""
    items = []
    for slot in range(size):
        position = (step * world + rank) * size + slot
        rng = np.random.default_rng((seed, 2, position))
        part = random_crop(cache[sample_index(len(cache), position, seed)], crop_size, config.bottom, rng)
        items.append((*augment(part.left, part.right, config, rng), part))
    return to_batch(items)


def whole_batch(sample: PackedSample) -> Batch:
    """One sample at full size, not augmented, for validation; labelled are the scored pixels (0.5 to 15 m) alone."""
    scale = np.float32(1 / 255)
    batch = to_batch([(sample.left * scale, sample.right * scale, sample)])
    scored = torch.from_numpy((sample.flags & 8) > 0)[None, None]
    return batch._replace(target=batch.target._replace(label=scored))


def batches(
    cache: PackedCache, start: int, size: int, crop_size: tuple[int, int], config: AugmentConfig, seed: int,
    rank: int = 0, world: int = 1, threads: int = 1,
) -> Generator[Batch, None, None]:  # fmt: skip
    """The batches of steps start, start + 1, ..., made ahead by background threads."""
    with ThreadPoolExecutor(threads, thread_name_prefix="loader") as pool:
        ahead: deque[Future[Batch]] = deque()
        step = start
        try:
            while True:
                while len(ahead) < threads + 2:
                    ahead.append(pool.submit(make_batch, cache, step, size, crop_size, config, seed, rank, world))
                    step += 1
                yield ahead.popleft().result()
        finally:
            for future in ahead:
                future.cancel()
