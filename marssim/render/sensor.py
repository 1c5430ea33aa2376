"""The camera's optics and detector, which turn radiance into 8-bit images."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from marssim.base.camera import PinholeCamera
from marssim.base.compute.compiled import compiled
from marssim.scene.ranges import Range, check_ranges

LEAST_METERED_SHARE = 0.05  # least share of the image at which ground or sky is metered separately
GAMMA = 2.2  # the 8-bit code of a signal is proportional to its share of full scale to the power 1 / GAMMA


@dataclass(frozen=True)
class SensorConfig:
    """Optics and detector. Each pair draws each value from its range, LOW HIGH; give a value twice to fix it."""

    exposure: Range = (0.40, 0.60)
    """8-bit code of the ground's median brightness as a share of 255, LOW HIGH. The image is darker where otherwise the
    ground's brightest 2 % would exceed 90 % of full scale, or half of the sky would saturate."""
    psf: Range = (0.35, 0.6)
    """Standard deviation of the point spread function [px], LOW HIGH: 0 is perfectly sharp. Above 1 its tails are cut
    off."""
    full_well: Range = (4000.0, 16000.0)
    """Number of electrons at full scale, LOW HIGH. Fewer electrons give more shot noise."""
    read_noise: Range = (4.0, 14.0)
    """Standard deviation of the read noise [electrons], LOW HIGH."""
    vignetting: Range = (0.0, 0.25)
    """Share of the light that is lost in the corners of the image, LOW HIGH, 0 to 1."""
    gain_difference: Range = (-0.02, 0.02)
    """How much brighter the right camera is than the left one, as a share, LOW HIGH."""
    noise_difference: Range = (-0.1, 0.1)
    """How much noisier the right camera is than the left one, as a share, LOW HIGH."""
    vertical_offset: Range = (-0.15, 0.15)
    """Residual error of rectification: how far the right image lies too low [px], LOW HIGH. The ground truth is that of
    the ideal rig."""
    rotation_deg: Range = (-0.015, 0.015)
    """Residual error of rectification: rotation of the right image about its middle [deg], LOW HIGH. Positive is
    clockwise."""

    def __post_init__(self) -> None:
        limits = {
            "exposure": (0.02, 0.98), "psf": (0, 2), "full_well": (10, 1e7), "read_noise": (0, 1e5),
            "vignetting": (0, 1), "gain_difference": (-0.9, 9),
            "noise_difference": (-0.9, 9), "vertical_offset": (-10, 10), "rotation_deg": (-5, 5),
        }  # fmt: skip
        check_ranges(self, limits)


@dataclass(frozen=True)
class Sensor:
    """The detectors of one stereo pair: the values of the left one, and how the right one differs.

    Attributes:
        exposure: 8-bit code of the ground's median brightness, as a share of 255.
        psf: Standard deviation of the point spread function [px].
        full_well: Number of electrons at full scale.
        read_noise: Standard deviation of the read noise [electrons].
        vignetting: Share of the light that is lost in the corners.
        gain_difference: How much brighter the right camera is, as a share.
        noise_difference: How much noisier the right camera is, as a share.
        vertical_offset: How far the right image lies too low [px].
        rotation_deg: Rotation of the right image about its middle [deg], positive is clockwise.
    """

    exposure: float
    psf: float
    full_well: float
    read_noise: float
    vignetting: float
    gain_difference: float = 0.0
    noise_difference: float = 0.0
    vertical_offset: float = 0.0
    rotation_deg: float = 0.0

    @classmethod
    def draw(cls, config: SensorConfig, rng: np.random.Generator) -> Sensor:
        """Draw each value uniformly from its range.

        Args:
            config: The ranges.
            rng: Random generator.
        """
        return cls(**{name: float(rng.uniform(low, high)) for name, (low, high) in vars(config).items()})

    @property
    def right(self) -> Sensor:
        """The right camera's detector: its noise is (1 + noise_difference) times the left one's at every brightness."""
        more = 1 + self.noise_difference
        return replace(self, full_well=self.full_well / more**2, read_noise=self.read_noise / more)

    def right_view(self, camera: PinholeCamera, pose: np.ndarray) -> np.ndarray:
        """Return the pose from which the right image is taken.

        A residual error of rectification is a small rotation of the camera in place: about its optical axis, and up by
        vertical_offset / fy, so that the image's middle moves down by vertical_offset.

        Args:
            camera: The right camera.
            pose: (4, 4) ideal pose of the right camera, camera to world.

        Returns:
            (4, 4) camera to world.
        """
        roll, pitch = np.deg2rad(self.rotation_deg), np.arctan(self.vertical_offset / camera.fy)
        out = np.array(pose, dtype=float)
        out[:3, :3] @= cv2.Rodrigues(np.array([pitch, 0.0, 0.0]))[0] @ cv2.Rodrigues(np.array([0.0, 0.0, -roll]))[0]
        return out

    def gain(self, radiance: np.ndarray, ground: np.ndarray) -> float:
        """Return the auto-exposure: the factor from radiance to full scale.

        Args:
            radiance: (H, W, 3) radiance of the left image.
            ground: (H, W) bool, the pixels that are not sky.
        """
        pixels, share = radiance.reshape(-1, 3), ground.mean()
        metered = ground.ravel() if share > LEAST_METERED_SHARE else np.ones(ground.size, bool)
        light, strongest = _metered(pixels, metered)
        high = min(int(0.98 * len(light)), len(light) - 1)
        middle, bright = float(np.median(light)), float(np.partition(strongest, high)[high])
        # `exposure` is a code, so its linear value is a power; the ground's highlights and most of the sky are kept
        gain = min(self.exposure**GAMMA / max(middle, 1e-6), 0.9 / max(bright, 1e-6))
        if share < 1 - LEAST_METERED_SHARE:
            _, sky = _metered(pixels, ~ground.ravel())
            gain = min(gain, 1 / max(float(np.median(sky)), 1e-6))
        return gain

    def expose(self, radiance: np.ndarray, gain: float, rng: np.random.Generator) -> np.ndarray:
        """Return the image of a radiance map, with blur, vignetting, noise and GAMMA.

        Args:
            radiance: (H, W, 3) linear RGB radiance.
            gain: Factor from radiance to full scale.
            rng: Random generator of the noise.

        Returns:
            (H, W, 3) uint8.
        """
        signal: np.ndarray = np.ascontiguousarray(radiance, dtype=np.float32)
        if self.psf > 0:
            signal = cv2.GaussianBlur(signal, (5, 5), self.psf, borderType=cv2.BORDER_REPLICATE)
        noise = rng.standard_normal(signal.shape, dtype=np.float32)
        return _codes(signal, noise, float(gain), self.vignetting, self.full_well, self.read_noise, CODE_STARTS, GUESS)


# least signal of each code from 1, as a share of full scale; no signal reaches the last entry
CODE_STARTS = np.append(((np.arange(1, 256) - 0.5) / 255) ** GAMMA, np.inf).astype(np.float32)
# entries of the table of guesses: so many that, above the darkest codes, a guess is right or one too low
GUESSES = 32768
GUESS = np.searchsorted(CODE_STARTS, np.arange(GUESSES + 1) / GUESSES, side="right").astype(np.uint8)


@compiled
def _metered(radiance, chosen):
    """Return the mean and the largest channel (M,) of the chosen (N,) pixels of radiance (N, 3)."""
    count = chosen.sum()
    mean, largest = np.empty(count, dtype=np.float32), np.empty(count, dtype=np.float32)
    m = 0
    for k in range(len(radiance)):
        if chosen[k]:
            red, green, blue = radiance[k, 0], radiance[k, 1], radiance[k, 2]
            mean[m] = (red + green + blue) / np.float32(3)
            largest[m] = max(red, green, blue)
            m += 1
    return mean, largest


@compiled
def _codes(signal, noise, gain, vignetting, full_well, read_noise, starts, guess):
    """Apply vignetting, noise and gamma. The code is looked up, with the same result as rounding the power."""
    height, width, _ = signal.shape
    out = np.empty(signal.shape, dtype=np.uint8)
    shot = np.float32(1 / full_well)  # variance of the noise per signal, both as shares of full scale
    floor = np.float32((read_noise / full_well) ** 2)
    black, white, guesses = np.float32(0), np.float32(1), np.float32(GUESSES)
    for row in range(height):
        y = 2 * row / max(height - 1, 1) - 1
        for column in range(width):
            x = 2 * column / max(width - 1, 1) - 1
            scale = np.float32(gain * (1 - vignetting * (x * x + y * y) / 2))
            for c in range(3):
                value = min(max(signal[row, column, c] * scale, black), white)
                value += noise[row, column, c] * math.sqrt(value * shot + floor)
                value = min(max(value, black), white)
                code = guess[np.int32(value * guesses)]
                while value >= starts[code]:
                    code += 1
                out[row, column, c] = code
    return out
