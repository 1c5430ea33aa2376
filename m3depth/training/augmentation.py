"""Crops of samples, and changes of their look that leave the ground truth valid."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import cv2
import numpy as np

from m3depth.stereo.degradation import LARGEST, MAX_VERTICAL
from m3depth.stereo.pairs import MAX_DISPARITY
from m3depth.training.packing import SCORED, TRAINED, PackedSample


@dataclass(frozen=True)
class AugmentConfig:
    """How crops are changed. Chances are per crop; every draw comes from the crop's own random generator.

    Raises:
        ValueError: A value that cannot work; the message names its flag.
    """

    contrast: float = 0.34
    """Lowest factor of the contrast, above 0 and up to 1. Three of five crops get a random factor from this to 1.25, or
    to 1 / this if that is lower, uniform in its logarithm. 1 leaves the contrast as it is."""
    brightness: float = 0.12
    """Largest shift of the brightness, up or down, as a share of the full range, 0 to 1."""
    gamma: float = 0.25
    """Largest change of gamma, 0 to 3: the exponent lies between exp(-this) and exp(this)."""
    eye_gain: float = 0.08
    """Largest difference in gain, 0 to 1: the right image is multiplied by a factor of up to 1 +- this."""
    noise: float = 0.02
    """Highest standard deviation of the noise, as a share of the full range, 0 to 1; half of the crops get some."""
    blur: float = 1.0
    """Highest standard deviation of a Gaussian blur [px], 0 to 100; a third of the crops is blurred; 0 for none."""
    grey: float = 0.3
    """Chance that a crop loses its colour, 0 to 1."""
    vertical: float = 0.5
    """Largest vertical offset of the right image [px], 0 to 16; half of the crops get one."""
    occlude: float = 0.25
    """Chance, 0 to 1, that patches of the right image are painted over, so that they match nothing."""
    bottom: float = 0.35
    """Chance, 0 to 1, that the crop touches the image's lower edge, where disparities are largest."""
    scale: float = 0.2
    """Half of the crops are enlarged or reduced by up to this share, 0 to 3, with camera and disparity."""

    def __post_init__(self) -> None:
        limits = {"brightness": 1.0, "gamma": 3.0, "eye_gain": 1.0, "scale": 3.0, "noise": 1.0}
        limits |= {"blur": LARGEST["blur"], "vertical": MAX_VERTICAL}
        limits |= dict.fromkeys(("contrast", "grey", "occlude", "bottom"), 1.0)
        for name, value in asdict(self).items():
            if not 0 <= value <= limits[name]:
                raise ValueError(f"--augment.{name.replace('_', '-')} must be 0 to {limits[name]:g}, got {value}")
            if value == 0:
                object.__setattr__(self, name, 0.0)  # not -0.0, for which NumPy draws nothing from -value to value
        if self.contrast == 0:
            raise ValueError("--augment.contrast must be over 0; 1 leaves the contrast as it is")


def crop(sample: PackedSample, y: int, x: int, height: int, width: int) -> PackedSample:
    """Cut out the part whose upper left pixel is (x, y); the principal point moves with it.

    Args:
        sample: The pair.
        y: Upper row of the part [px].
        x: Left column of the part [px].
        height: Height of the part [px].
        width: Width of the part [px].
    """
    window = np.s_[y : y + height, x : x + width]
    fx, fy, cx, cy = sample.camera
    left, right, disparity, normal, flags = (a[window] for a in sample[:5])
    camera = (fx, fy, cx - x, cy - y)
    return PackedSample(left, right, disparity, normal, flags, camera, sample.baseline, sample.reduction)


def check_crop(sample: PackedSample, size: tuple[int, int], name: str) -> None:
    """Raise ValueError if the images are smaller than the crops.

    Args:
        sample: The pair.
        size: Height and width of the crops [px].
        name: Name of the pair, for the message.
    """
    height, width = sample.left.shape[:2]
    if size[0] > height or size[1] > width:
        raise ValueError(f"--crop {size[0]} {size[1]} is larger than the images, {height} x {width} px in {name}")


def random_crop(
    sample: PackedSample, size: tuple[int, int], config: AugmentConfig, rng: np.random.Generator
) -> PackedSample:
    """Draw a crop, cut out at that size or resized from a slightly different one.

    Where the cost volume works on a reduced pair, the crop has that size once it is reduced. If the images are smaller
    than such a crop, it is reduced less or not at all, and larger disparities are not trained.

    Args:
        sample: The pair, whose images are at least as large as the crop (check_crop).
        size: Height and width of the crop for the cost volume [px].
        config: Chances and sizes of the changes.
        rng: Draws the crop.
    """
    height, width = sample.left.shape[:2]
    reduction = sample.reduction
    while reduction > 1 and (reduction * size[0] > height or reduction * size[1] > width):
        reduction //= 2
    size = reduction * size[0], reduction * size[1]
    highest = np.log1p(config.scale)
    factor = np.exp(rng.uniform(-highest, highest)) if rng.random() < 0.5 else 1.0
    factor = max(factor, size[0] / height, size[1] / width)
    window = round(size[0] / factor), round(size[1] / factor)
    spare_y, spare_x = height - window[0], width - window[1]
    y = spare_y if rng.random() < config.bottom else int(rng.integers(spare_y + 1))
    part = crop(sample, y, int(rng.integers(spare_x + 1)), *window)
    return within_reach(part._replace(reduction=reduction)) if window == size else resized(part, size, reduction)


def within_reach(sample: PackedSample) -> PackedSample:
    """Return the pair without the flags TRAINED and SCORED where disparities are beyond the network's reach."""
    reach = sample.reduction * MAX_DISPARITY
    keep = np.where(sample.disparity <= reach, 255, 255 - TRAINED - SCORED).astype(np.uint8)
    return sample._replace(flags=sample.flags & keep)


def resized(sample: PackedSample, size: tuple[int, int], reduction: int = 1) -> PackedSample:
    """Resample the pair, as cameras of another resolution would see it.

    Both images are resampled alike, so a disparity d becomes d s_x, and fx and fy become fx s_x and fy s_y. Disparities
    beyond the network's reach are then no longer trained. Disparity is interpolated on surfaces; it is the nearest
    pixel's where it is unknown or changes by more than 1 px within 3 x 3 px. Normals and flags are the nearest pixel's.

    Args:
        sample: The pair.
        size: New height and width [px].
        reduction: Factor by which the cost volume's pair is smaller than the new one.
    """
    height, width = sample.left.shape[:2]
    sy, sx = size[0] / height, size[1] / width

    def nearest(image: np.ndarray) -> np.ndarray:
        return cv2.resize(image, size[::-1], interpolation=cv2.INTER_NEAREST_EXACT)

    images = [
        cv2.resize(eye, size[::-1], interpolation=cv2.INTER_AREA if sx < 1 else cv2.INTER_LINEAR)
        for eye in (sample.left, sample.right)
    ]
    window = np.ones((3, 3), np.uint8)
    span = cv2.dilate(sample.disparity, window) - cv2.erode(sample.disparity, window)
    smooth = (span <= 1) & (cv2.erode(sample.flags & TRAINED, window) > 0)
    disparity = np.where(
        nearest(smooth.astype(np.uint8)) > 0,
        cv2.resize(sample.disparity, size[::-1], interpolation=cv2.INTER_LINEAR),
        nearest(sample.disparity),
    )
    fx, fy, cx, cy = sample.camera
    camera = (fx * sx, fy * sy, (cx + 0.5) * sx - 0.5, (cy + 0.5) * sy - 0.5)
    disparity = (disparity * sx).astype(np.float32)
    truth = disparity, nearest(sample.normal), nearest(sample.flags)
    return within_reach(PackedSample(images[0], images[1], *truth, camera, sample.baseline, reduction))


def augment(
    left: np.ndarray, right: np.ndarray, config: AugmentConfig, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Change how a pair looks, but not what it shows.

    Args:
        left, right: (H, W, 3) uint8.
        config: What is changed.
        rng: Draws the changes.

    Returns:
        Both images, (H, W, 3) float32 in [0, 1].
    """
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
