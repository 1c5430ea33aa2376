"""The camera's optics and detector, which turn radiance into 8-bit images.

The effects are in the folder `detector`, one a file. Those that a sound camera in good light does not have are called
faults. They are off by default.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from marssim.base.camera import PinholeCamera
from marssim.render.detector.charge import bled, in_full_scale, with_smear
from marssim.render.detector.codes import Readout, stretch_limits
from marssim.render.detector.compression import sent
from marssim.render.detector.dust import through_dust
from marssim.render.detector.glare import with_glare
from marssim.render.detector.hot_pixels import with_hot_pixels
from marssim.render.detector.metering import metered_gain
from marssim.render.detector.motion import moved
from marssim.scene.ranges import Range, check_ranges

LOSSLESS = 100.0  # quality of the JPEG that stands for no compression
ALWAYS = (
    "exposure", "psf", "full_well", "read_noise", "vignetting", "gain_difference", "noise_difference",
    "vertical_offset", "rotation_deg",
)  # fmt: skip
# A pair has each of these with the chance fault_chance. New ones come last, so that the others keep their draws.
FAULTS = (
    "horizontal_offset", "dust", "motion_blur", "glare", "overexposure", "bleeding", "smear", "stretch", "jpeg_quality",
    "hot_pixels", "sun_glare",
)  # fmt: skip
ABSENT = {**dict.fromkeys(FAULTS, 0.0), "jpeg_quality": LOSSLESS}  # values of a pair without the fault
OF_FAULTS = ("motion_direction_deg", "stretch_alone")  # values that only matter with a fault


LIMITS = {
    "exposure": (0.02, 0.98), "psf": (0, 2), "full_well": (10, 1e7), "read_noise": (0, 1e5),
    "vignetting": (0, 1), "gain_difference": (-0.9, 9), "noise_difference": (-0.9, 9),
    "vertical_offset": (-10, 10), "rotation_deg": (-5, 5), "horizontal_offset": (-10, 10), "dust": (0, 0.8),
    "motion_blur": (0, 50), "motion_direction_deg": (-360, 360), "glare": (0, 1), "sun_glare": (0, 1),
    "overexposure": (-6, 6), "bleeding": (0, 1), "smear": (0, 1), "hot_pixels": (0, 1e5), "stretch": (0, 0.2),
    "stretch_alone": (0, 1), "jpeg_quality": (1, LOSSLESS), "fault_chance": (0, 1),
}  # fmt: skip
"""Least and largest value of the settings of SensorConfig."""
OF_ONE_EYE = ("full_well", "read_noise")  # of the right eye they follow from those of the left one


@dataclass(frozen=True)
class SensorConfig:
    """Optics and detector. Each pair draws each value from its range, LOW HIGH; give a value twice to fix it."""

    exposure: Range = (0.40, 0.60)
    """8-bit code of the ground's median brightness as a share of 255, before vignetting, LOW HIGH, 0.02 to 0.98. The
    image is darker where otherwise the ground's brightest 2 % would exceed 90 % of full scale, or half of the sky would
    saturate."""
    psf: Range = (0.35, 0.6)
    """Sigma of the Gaussian point spread function [px], LOW HIGH, 0 to 2: 0 is perfectly sharp. It is sampled at the
    middles of 5 x 5 pixels, so the image spreads by 0.28 px for 0.4, 0.59 for 0.6, 0.96 for 1 and 1.29 for 2."""
    full_well: Range = (4000.0, 16000.0)
    """Number of electrons at full scale, LOW HIGH, 10 to 10,000,000. Fewer electrons give more shot noise."""
    read_noise: Range = (4.0, 14.0)
    """Standard deviation of the read noise [electrons], LOW HIGH, 0 to 100,000."""
    vignetting: Range = (0.0, 0.25)
    """Share of the light that is lost in the corners of the image, LOW HIGH, 0 to 1."""
    gain_difference: Range = (-0.02, 0.02)
    """How much brighter the right camera is than the left one, as a share, LOW HIGH, -0.9 to 9."""
    noise_difference: Range = (-0.1, 0.1)
    """How much noisier the right camera is than the left one, as a share, LOW HIGH, -0.9 to 9."""
    vertical_offset: Range = (-0.15, 0.15)
    """Residual error of rectification: how far the right image lies too low [px], LOW HIGH, -10 to 10. Disparity and
    occlusion in the ground truth follow this and the two other residual errors; depth and normals do not depend on
    them."""
    rotation_deg: Range = (-0.015, 0.015)
    """Residual error of rectification: rotation of the right image about its principal point [deg], LOW HIGH, -5 to 5.
    Positive is clockwise."""
    horizontal_offset: Range = (0.0, 0.0)
    """Residual error of rectification: how far the right image lies too far right [px], LOW HIGH, -10 to 10, as if the
    cameras were not quite parallel. Depth that is computed as f B / disparity is then wrong."""
    dust: Range = (0.0, 0.0)
    """Dust on the windows of the cameras, LOW HIGH, 0 to 0.8: about the share of the light that it takes away, up to
    0.3; 0.4 takes away a third, and 0.8 half. Each camera has soft specks of its own and a veil, which also add
    scattered light. A drive keeps its specks."""
    motion_blur: Range = (0.0, 0.0)
    """How far both images move during the exposure [px], LOW HIGH, 0 to 50. Interpolation softens them by up to half a
    pixel more."""
    motion_direction_deg: Range = (0.0, 180.0)
    """Direction of the motion blur in the image [deg], LOW HIGH, -360 to 360: 0 is along the rows, 90 along the
    columns."""
    glare: Range = (0.0, 0.0)
    """Share of the light that the lenses scatter around where it belongs, LOW HIGH, 0 to 1: bright regions get a halo,
    and shadows lose contrast."""
    sun_glare: Range = (0.0, 0.0)
    """Share of the sunlight on the lenses that they scatter, LOW HIGH, 0 to 1: with the sun before the camera, also
    outside its view, the images get a veil that is brighter towards the sun."""
    overexposure: Range = (0.0, 0.0)
    """How much longer the exposure is than the light asks for [stops], LOW HIGH, -6 to 6; negative values darken the
    images."""
    bleeding: Range = (0.0, 0.0)
    """Share of the charge beyond full scale that saturated pixels spill into their column, LOW HIGH, 0 to 1. It shows
    where something saturates, as with --sensor.overexposure."""
    smear: Range = (0.0, 0.0)
    """Time in which a frame-transfer CCD moves its charge, as a share of the exposure, LOW HIGH, 0 to 1: each pixel
    also collects light of its whole column."""
    hot_pixels: Range = (0.0, 0.0)
    """Pixels in a million that collect charge without light, LOW HIGH, 0 to 100,000; Curiosity's Navcam has some 1,000.
    Each camera has its own, and a drive keeps them."""
    stretch: Range = (0.0, 0.0)
    """Share of the values that a contrast stretch turns black, and share that it turns white, LOW HIGH, 0 to 0.2. The
    public images of rovers have 0.005 to 0.01; 0 does not stretch."""
    stretch_alone: Range = (0.0, 0.0)
    """Whether the stretch has common limits for both images, 0, or separate ones for each, 1, as public images have;
    LOW HIGH, and values between mix the limits."""
    jpeg_quality: Range = (LOSSLESS, LOSSLESS)
    """Quality of the JPEG in which the images are sent, LOW HIGH, 1 to 100. Rovers send 65 to 95; 100 stands for no
    compression."""
    fault_chance: Range = (1.0, 1.0)
    """Chance with which a pair has each of the faults, LOW HIGH, 0 to 1: horizontal offset, dust, motion blur, glare,
    overexposure, bleeding, smear, hot pixels, stretch, JPEG and glare of the sun. Each is drawn for itself."""

    def __post_init__(self) -> None:
        check_ranges(self, LIMITS)


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
        rotation_deg: Rotation of the right image about its principal point [deg], positive is clockwise.
        horizontal_offset: How far the right image lies too far right [px].
        dust: Share of the light that dust on the windows takes away.
        motion_blur: How far both images move during the exposure [px].
        motion_direction_deg: Direction of that motion [deg], clockwise from the rows.
        glare: Share of the light that the lenses scatter.
        sun_glare: Share of the sunlight on the lenses that they scatter.
        overexposure: How much longer the exposure is than the light asks for [stops].
        bleeding: Share of the charge beyond full scale that spills into its column.
        smear: Time of a CCD's frame transfer as a share of the exposure.
        hot_pixels: Pixels in a million that collect charge without light.
        stretch: Share of the values that become black, and share that become white.
        stretch_alone: 0 stretches both images between common limits, 1 each between its own.
        jpeg_quality: Quality of the JPEG; 100 stands for no compression.
        fault_chance: Chance with which each fault was drawn.
        seed: Seed of the dust and of the hot pixels.

    Raises:
        ValueError: A value is not finite, or out of the range that SensorConfig has for it. Only full_well and
            read_noise may have any positive value.
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
    horizontal_offset: float = 0.0
    dust: float = 0.0
    motion_blur: float = 0.0
    motion_direction_deg: float = 0.0
    glare: float = 0.0
    sun_glare: float = 0.0
    overexposure: float = 0.0
    bleeding: float = 0.0
    smear: float = 0.0
    hot_pixels: float = 0.0
    stretch: float = 0.0
    stretch_alone: float = 0.0
    jpeg_quality: float = LOSSLESS
    fault_chance: float = 1.0
    seed: int = 0

    def __post_init__(self) -> None:
        for name, (low, high) in LIMITS.items():
            value = getattr(self, name)
            if name in OF_ONE_EYE:
                low, high = 0, np.inf
            if not (np.isfinite(value) and low <= value <= high) or (name == "full_well" and value == 0):
                raise ValueError(f"{name} must be finite, and {low:g} to {high:g}, got {value}")

    @classmethod
    def draw(cls, config: SensorConfig, rng: np.random.Generator) -> Sensor:
        """Draw each value uniformly from its range. Faults are drawn from a generator of their own.

        Args:
            config: The ranges.
            rng: Random generator.
        """
        values = {name: float(rng.uniform(*getattr(config, name))) for name in ALWAYS}
        fault_rng = rng.spawn(1)[0]
        seed = int(fault_rng.integers(2**32))
        values |= {n: float(fault_rng.uniform(*getattr(config, n))) for n in ("fault_chance", *OF_FAULTS)}
        for name in FAULTS:
            present, value = fault_rng.random() < values["fault_chance"], fault_rng.uniform(*getattr(config, name))
            values[name] = float(value if present else ABSENT[name])
        return cls(**values, seed=seed)

    @property
    def right(self) -> Sensor:
        """The right camera's detector: its noise is (1 + noise_difference) times the left one's at every brightness."""
        more = 1 + self.noise_difference
        return replace(self, full_well=self.full_well / more**2, read_noise=self.read_noise / more)

    def right_rotation(self, camera: PinholeCamera) -> np.ndarray:
        """Return how the right camera is turned when it takes its image.

        A residual error of rectification is a small rotation of the camera in place: about its optical axis, up by
        vertical_offset / fy and left by horizontal_offset / fx, so that the principal point moves by these offsets.

        Args:
            camera: The right camera.

        Returns:
            (3, 3) frame of the right camera to that of the ideal right camera.
        """
        roll, pitch = np.deg2rad(self.rotation_deg), np.arctan(self.vertical_offset / camera.fy)
        yaw = np.arctan(self.horizontal_offset / camera.fx)
        turns = [[0.0, -yaw, 0.0], [pitch, 0.0, 0.0], [0.0, 0.0, -roll]]
        first, second, third = (cv2.Rodrigues(np.array(turn))[0] for turn in turns)
        return first @ second @ third

    def expose_pair(
        self, left: np.ndarray, right: np.ndarray, ground: np.ndarray, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the images of both radiance maps, with the exposure that the left one asks for.

        Args:
            left, right: (H, W, 3) linear RGB radiance.
            ground: (H, W) bool, the pixels of the left image that are not sky.
            rng: Random generator of the noise.

        Returns:
            Two (H, W, 3) uint8 RGB images.

        Raises:
            ValueError: An array has another shape, or light that is not finite. The message names it.
        """
        left, right, ground = (
            _checked_light(left, "left"),
            _checked_light(right, "right"),
            np.asarray(ground, dtype=bool),
        )
        if not left.shape == right.shape == (*ground.shape, 3):
            raise ValueError(
                f"left, right and ground must be of one size, got {left.shape}, {right.shape}, {ground.shape}"
            )
        if self.dust > 0:
            left, right = (through_dust(light, self.dust, self.seed, eye) for eye, light in enumerate((left, right)))
        gain = self.gain(left, ground) * 2**self.overexposure
        readouts = [
            self._readout(left, gain, rng),
            self.right._readout(right, gain * (1 + self.gain_difference), rng, eye=1),
        ]
        images = [readout.codes() for readout in readouts]
        if self.stretch > 0:
            images = [part.codes(limits) for part, limits in zip(readouts, self._limits(images), strict=True)]
        if (quality := round(self.jpeg_quality)) < LOSSLESS:
            images = [sent(image, quality) for image in images]
        return images[0], images[1]

    def _limits(self, images: list[np.ndarray]) -> list[tuple[float, float]]:
        """Return the limits of each image's stretch."""
        low, high = stretch_limits(np.stack(images), self.stretch)
        separate = self.stretch_alone
        limits = [stretch_limits(image, self.stretch) for image in images]
        return [(low + separate * (black - low), high + separate * (white - high)) for black, white in limits]

    def gain(self, radiance: np.ndarray, ground: np.ndarray) -> float:
        """Return the auto-exposure: the factor from radiance to full scale.

        Args:
            radiance: (H, W, 3) radiance of the left image.
            ground: (H, W) bool, the pixels that are not sky.
        """
        return metered_gain(radiance, ground, self.exposure)

    def expose(self, radiance: np.ndarray, gain: float, rng: np.random.Generator) -> np.ndarray:
        """Return the image of one radiance map. It has no dust, no stretch and no compression, which concern a pair.

        Args:
            radiance: (H, W, 3) linear RGB radiance.
            gain: Factor from radiance to full scale.
            rng: Random generator of the noise.

        Returns:
            (H, W, 3) uint8.

        Raises:
            ValueError: The radiance has another shape, or it or the gain is not finite. The message names it.
        """
        if not np.isfinite(gain):
            raise ValueError(f"gain must be finite, got {gain}")
        return self._readout(_checked_light(radiance, "radiance"), gain, rng).codes()

    def _readout(self, radiance: np.ndarray, gain: float, rng: np.random.Generator, eye: int = 0) -> Readout:
        """Return what the detector of an eye, 0 or 1, holds of a radiance map, with noise that is drawn now."""
        signal: np.ndarray = np.ascontiguousarray(radiance, dtype=np.float32)
        if self.motion_blur > 0:
            signal = moved(signal, self.motion_blur, self.motion_direction_deg)
        if self.psf > 0:
            signal = cv2.GaussianBlur(signal, (5, 5), self.psf, borderType=cv2.BORDER_REPLICATE)
        if self.glare > 0:
            signal = with_glare(signal, self.glare)
        vignetting, gain = self.vignetting, float(gain)
        if self.smear > 0 or self.hot_pixels > 0 or self.bleeding > 0:
            signal = with_smear(in_full_scale(signal, gain, vignetting), self.smear)
            signal = with_hot_pixels(signal, self.hot_pixels, self.seed, eye)
            signal = bled(signal, self.bleeding)
            vignetting, gain = 0.0, 1.0
        noise = rng.standard_normal(signal.shape, dtype=np.float32)
        return Readout(signal, noise, gain, vignetting, self.full_well, self.read_noise)


def _checked_light(radiance: np.ndarray, name: str) -> np.ndarray:
    """Return a radiance map (H, W, 3) as an array. Raises ValueError, which names it, for another shape, NaN or inf."""
    light = np.asarray(radiance)
    if light.ndim != 3 or light.shape[2] != 3:
        raise ValueError(f"{name} must have shape (H, W, 3), got {light.shape}")
    if not np.isfinite(light).all():
        raise ValueError(f"{name} must be finite light")
    return light
