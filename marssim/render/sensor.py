"""The camera's optics and detector: radiance in, 8-bit image out."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from marssim.base.camera import PinholeCamera
from marssim.base.compute.compiled import compiled
from marssim.scene.ranges import Range, check_ranges

LEAST = 0.05  # share of the image from which ground or sky is metered for itself
GAMMA = 2.2  # a code is its share of full scale to the power 1 / GAMMA


@dataclass(frozen=True)
class SensorConfig:
    """Optics and detector. Each pair draws from these ranges, LOW HIGH; give a value twice to fix it."""

    exposure: Range = (0.40, 0.60)
    """8-bit code that the ground's median brightness is brought to, as a share of 255; a lower one where the ground's
    brightest fiftieth would else be over nine tenths of full scale in a channel, or half of the sky saturated"""
    psf: Range = (0.35, 0.6)
    """standard deviation of the point spread [px]; 0 is perfectly sharp, above 1 the tails are cut"""
    full_well: Range = (4000.0, 16000.0)
    """electrons at full scale; the fewer, the more shot noise"""
    read_noise: Range = (4.0, 14.0)
    """standard deviation of the read noise [electrons]"""
    vignetting: Range = (0.0, 0.25)
    """share of the light that is lost in the corners of the image, 0 to 1"""
    gain_difference: Range = (-0.02, 0.02)
    """how much brighter the right eye is than the left, as a share"""
    noise_difference: Range = (-0.1, 0.1)
    """how much noisier the right eye is than the left, as a share"""
    vertical_offset: Range = (-0.15, 0.15)
    """what rectification left: how far the right image stands too low [px]; the ground truth is the ideal rig's"""
    rotation_deg: Range = (-0.015, 0.015)
    """what rectification left: turn of the right image about its middle [deg], positive is clockwise"""

    def __post_init__(self) -> None:
        limits = {
            "exposure": (0.02, 0.98), "psf": (0, 2), "full_well": (10, 1e7), "read_noise": (0, 1e5),
            "vignetting": (0, 1), "gain_difference": (-0.9, 9),
            "noise_difference": (-0.9, 9), "vertical_offset": (-10, 10), "rotation_deg": (-5, 5),
        }  # fmt: skip
        check_ranges(self, limits)


@dataclass(frozen=True)
class Sensor:
    """One drawn pair of detectors: the left one's values, and how the right one and its rectification differ."""

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
        """A detector whose values lie anywhere in the ranges of config, all equally likely."""
        return cls(**{name: float(rng.uniform(low, high)) for name, (low, high) in vars(config).items()})

    @property
    def right(self) -> Sensor:
        """The right eye's detector: (1 + noise_difference) times the noise at every brightness."""
        more = 1 + self.noise_difference
        return replace(self, full_well=self.full_well / more**2, read_noise=self.read_noise / more)

    def right_view(self, camera: PinholeCamera, pose: np.ndarray) -> np.ndarray:
        """(4, 4) pose from which the right image is taken, given that of the ideal right eye.

        A residual of rectification is a small turn of the camera where it stands: about its optical axis, and up by
        vertical_offset / fy, so that the image's middle moves down by vertical_offset.
        """
        roll, pitch = np.deg2rad(self.rotation_deg), np.arctan(self.vertical_offset / camera.fy)
        out = np.array(pose, dtype=float)
        out[:3, :3] @= cv2.Rodrigues(np.array([pitch, 0.0, 0.0]))[0] @ cv2.Rodrigues(np.array([0.0, 0.0, -roll]))[0]
        return out

    def gain(self, radiance: np.ndarray, ground: np.ndarray) -> float:
        """Auto-exposure: the factor from radiance to full scale. radiance: (H, W, 3); ground: (H, W) bool, not sky."""
        pixels, share = radiance.reshape(-1, 3), ground.mean()
        light, strongest = _metered(pixels, ground.ravel() if share > LEAST else np.ones(ground.size, bool))
        high = min(int(0.98 * len(light)), len(light) - 1)
        middle, bright = float(np.median(light)), float(np.partition(strongest, high)[high])
        # that code value stands for this linear value; highlights of the ground and most of the sky are kept
        gain = min(self.exposure**GAMMA / max(middle, 1e-6), 0.9 / max(bright, 1e-6))
        if share < 1 - LEAST:
            _, sky = _metered(pixels, ~ground.ravel())
            gain = min(gain, 1 / max(float(np.median(sky)), 1e-6))
        return gain

    def expose(self, radiance: np.ndarray, gain: float, rng: np.random.Generator) -> np.ndarray:
        """(H, W, 3) uint8 image of a radiance image (H, W, 3), with blur, vignetting, noise and GAMMA."""
        signal: np.ndarray = np.ascontiguousarray(radiance, dtype=np.float32)
        if self.psf > 0:
            signal = cv2.GaussianBlur(signal, (5, 5), self.psf, borderType=cv2.BORDER_REPLICATE)
        noise = rng.standard_normal(signal.shape, dtype=np.float32)
        return _codes(signal, noise, float(gain), self.vignetting, self.full_well, self.read_noise, CODE_STARTS, GUESS)


# signal, as a share of full scale, from which each code from 1 is given; no signal reaches the last one
CODE_STARTS = np.append(((np.arange(1, 256) - 0.5) / 255) ** GAMMA, np.inf).astype(np.float32)
GUESSES = 32768  # so many that the code of a signal is its guess or, above the darkest few, at most the next one
GUESS = np.searchsorted(CODE_STARTS, np.arange(GUESSES + 1) / GUESSES, side="right").astype(np.uint8)


@compiled
def _metered(radiance, chosen):
    """Mean and largest of the channels (M,) of the pixels (N, 3) that are chosen (N,)."""
    count = chosen.sum()
    mean, largest = np.empty(count, dtype=np.float32), np.empty(count, dtype=np.float32)
    found = 0
    for k in range(len(radiance)):
        if chosen[k]:
            red, green, blue = radiance[k, 0], radiance[k, 1], radiance[k, 2]
            mean[found] = (red + green + blue) / np.float32(3)
            largest[found] = max(red, green, blue)
            found += 1
    return mean, largest


@compiled
def _codes(signal, noise, gain, vignetting, full_well, read_noise, starts, guess):
    """Vignetting, noise and gamma; the code of a signal is looked up, which gives what rounding its power would."""
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
