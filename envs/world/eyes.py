"""The rover's eyes: how many pixels they have, what is wrong with them, and how often they look."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Integral, Real

from marssim.base.camera import NATECAM, StereoRig
from marssim.render.sensor import LOSSLESS, SensorConfig
from marssim.render.temperature import MOST_KELVIN, at_temperature

# least and largest value of each setting, and its unit
EYES_LIMITS = {
    "image_pixels": (64, 2048, " px"),
    "ground_truth_pixels": (64, 2048, " px"),
    "lens_dust": (0, 0.8, ""),
    "lens_glare": (0, 1, ""),
    "temperature": (-MOST_KELVIN, MOST_KELVIN, " K"),
    "jpeg_quality": (1, LOSSLESS, ""),
    "look_every": (0, 100, " m"),
}

DEPTH_PIXELS = 64  # [px] along a side of the observed depth: the sides of what it is made of are multiples of them
FAST_PIXELS = 128  # of the true depth where it is not compared: enough to drive
AS_IMAGES = 0  # in place of a number of its pixels: as many as the images have


@dataclass(frozen=True)
class EyesConfig:
    """NaTeCam on a drive. All images show the same view, whatever their size."""

    image_pixels: int = 512
    """Width and height of the images that the perception sees [px], a multiple of 64 up to 2048."""
    ground_truth_pixels: int | None = None
    """Width and height of the depth that ground_truth reads [px], a multiple of 64 up to 2048, or 0 for those of the
    images. Left out: 128, which is enough to drive, and fast; in envs.evaluate 0, where other perceptions drive too."""
    lens_dust: float = 0.0
    """Dust on the windows of the cameras, 0 to 0.8: about the share of the light that it takes away, up to 0.3. The
    specks are at most 400, so that 0.4 takes away a third, and 0.8 half. Each camera has specks of its own, which stay
    for the drive, and a veil."""
    lens_glare: float = 0.0
    """Share of the sunlight on the lenses that they scatter into the images, 0 to 1: a veil while the sun stands before
    the cameras, also outside their view."""
    temperature: float = 0.0
    """How much warmer the cameras are than when they were calibrated [K], -100 to 100: their rig bends. At 50 K the
    rows of the images are 0.7 px apart and the eyes converge by 0.5 px, at 512 px, and the right one is 10 percent
    brighter."""
    jpeg_quality: float = LOSSLESS
    """Quality of the JPEG that the perception sees the images after, 1 to 100; 100 does not compress them."""
    look_every: float = 0.0
    """Way after which the rover looks again [m], 0 to 100: at the end of the first step, of 0.4 m at most, by which it
    has driven this far. Straight ahead a step is a little less than 0.4 m, so 4 is a look every 4.4 m. It also looks
    after a step in which it was to stand still. 0 looks after every step."""

    def __post_init__(self) -> None:
        for name, (low, high, unit) in EYES_LIMITS.items():
            value, kind = getattr(self, name), Integral if unit == " px" else Real
            if name == "ground_truth_pixels" and (
                value is None or (value == AS_IMAGES and not isinstance(value, bool))
            ):
                continue
            if isinstance(value, bool) or not isinstance(value, kind) or not low <= float(value) <= high:
                whole = "be a whole number" if kind is Integral else "lie"
                raise ValueError(f"{name} must {whole} in [{low:g}, {high:g}]{unit}, got {value!r}")
            if unit == " px" and value % DEPTH_PIXELS:
                raise ValueError(f"{name} must be a multiple of {DEPTH_PIXELS} px, got {value}")

    @property
    def rig(self) -> StereoRig:
        """The cameras at the size of their images."""
        n = self.image_pixels
        return NATECAM if n == NATECAM.camera.width else NATECAM.resized(n, n)

    @property
    def ground_truth_rig(self) -> StereoRig:
        """The cameras at the size of the depth that the ground truth reads."""
        n = FAST_PIXELS if self.ground_truth_pixels is None else self.ground_truth_pixels or self.image_pixels
        return NATECAM.resized(n, n)

    def sensor(self) -> SensorConfig:
        """Return the ranges from which a drive draws its two detectors."""
        sensor = SensorConfig(
            dust=(self.lens_dust,) * 2, jpeg_quality=(self.jpeg_quality,) * 2, sun_glare=(self.lens_glare,) * 2
        )
        return at_temperature(sensor, self.temperature, self.rig)
