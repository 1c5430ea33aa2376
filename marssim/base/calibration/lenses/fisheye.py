"""The fisheye of OpenCV, which Kalibr and ROS call equidistant (Kannala and Brandt 2006).

With theta the angle between a point and the optical axis, and phi its direction in the image:

    t = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8)
    u = fx (t cos phi + skew t sin phi) + cx,  v = fy t sin phi + cy
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from marssim.base.calibration.lenses.curve import RisingCurve
from marssim.base.calibration.lenses.lens import Lens, Rays, split


@dataclass(frozen=True)
class Fisheye(Lens):
    """A fisheye lens.

    Attributes:
        fx, fy: Focal lengths [px].
        cx, cy: Principal point [px].
        coefficients: k1, k2, k3, k4.
        skew: OpenCV's alpha.

    Raises:
        ValueError: Not 4 coefficients, or a focal length that is not positive.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    coefficients: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    skew: float = 0.0

    def __post_init__(self) -> None:
        if not (self.fx > 0 and self.fy > 0):
            raise ValueError(f"the focal lengths must be positive, got {self.fx:g} and {self.fy:g} px")
        if len(self.coefficients) != 4:
            raise ValueError(f"a fisheye has 4 coefficients of distortion, got {len(self.coefficients)}")

    @cached_property
    def _curve(self) -> RisingCurve:
        return RisingCurve((1.0, *self.coefficients), most=np.pi)

    def focal(self) -> float:
        return float(np.sqrt(self.fx * self.fy))

    def project(self, points: np.ndarray) -> np.ndarray:
        x, y, z = split(points)
        radius = np.hypot(x, y)
        t = self._curve(np.arctan2(radius, z))
        safe = np.where(radius > 0, radius, 1)
        x, y = t * x / safe, t * y / safe
        return np.stack([self.fx * (x + self.skew * y) + self.cx, self.fy * y + self.cy], axis=-1)

    def rays(self, pixels: np.ndarray) -> Rays:
        pixels = np.asarray(pixels, dtype=float)
        y = (pixels[..., 1] - self.cy) / self.fy
        x = (pixels[..., 0] - self.cx) / self.fx - self.skew * y
        t = np.hypot(x, y)
        theta = self._curve.inverse(t)
        safe = np.where(t > 0, t, 1)
        direction = np.stack([np.sin(theta) * x / safe, np.sin(theta) * y / safe, np.cos(theta)], axis=-1)
        return Rays(np.zeros_like(direction), direction)
