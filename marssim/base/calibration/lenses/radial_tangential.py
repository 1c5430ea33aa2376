"""The pinhole camera with radial and tangential distortion, as OpenCV, ROS (plumb_bob) and Kalibr (radtan) have it.

With x = X / Z, y = Y / Z and r^2 = x^2 + y^2 (OpenCV, "Camera Calibration and 3D Reconstruction"; Brown 1966):

    f = (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6)
    x' = x f + 2 p1 x y + p2 (r^2 + 2 x^2) + s1 r^2 + s2 r^4
    y' = y f + p1 (r^2 + 2 y^2) + 2 p2 x y + s3 r^2 + s4 r^4
    u = fx x' + cx,  v = fy y' + cy
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from marssim.base.calibration.lenses.curve import RisingCurve
from marssim.base.calibration.lenses.lens import Lens, Rays, split, unit

COUNTS = (0, 4, 5, 8, 12, 14)  # numbers of coefficients that OpenCV knows
NEWTON_STEPS = 50


@dataclass(frozen=True)
class RadialTangential(Lens):
    """A pinhole camera with distortion.

    Attributes:
        fx, fy: Focal lengths [px].
        cx, cy: Principal point [px].
        coefficients: k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 in OpenCV's order, or the first 4, 5 or 8; empty
            for a pinhole. Two more, OpenCV's tilt of the detector, must be 0.

    Raises:
        ValueError: Another number of coefficients, or a focal length that is not positive.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    coefficients: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if not (self.fx > 0 and self.fy > 0):
            raise ValueError(f"the focal lengths must be positive, got {self.fx:g} and {self.fy:g} px")
        if len(self.coefficients) not in COUNTS:
            raise ValueError(f"distortion has 0, 4, 5, 8 or 12 coefficients, got {len(self.coefficients)}")
        if any(self.coefficients[12:]):
            raise ValueError("distortion with a tilted detector (OpenCV's 14 coefficients) is not supported")

    @cached_property
    def _terms(self) -> np.ndarray:
        out = np.zeros(12)
        out[: min(12, len(self.coefficients))] = self.coefficients[:12]
        return out

    @cached_property
    def _radial(self) -> RisingCurve:
        k1, k2, _, _, k3, k4, k5, k6 = self._terms[:8]
        return RisingCurve((1.0, k1, k2, k3), (k4, k5, k6) if any((k4, k5, k6)) else ())

    def focal(self) -> float:
        return float(np.sqrt(self.fx * self.fy))

    def project(self, points: np.ndarray) -> np.ndarray:
        x, y, z = split(points)
        with np.errstate(all="ignore"):
            ahead = np.where(z > 0, z, np.nan)
            x, y = x / ahead, y / ahead
            inside = np.hypot(x, y) < self._radial.limit
        x, y, _ = self._distorted(np.where(inside, x, np.nan), np.where(inside, y, np.nan))
        return np.stack([self.fx * x + self.cx, self.fy * y + self.cy], axis=-1)

    def rays(self, pixels: np.ndarray) -> Rays:
        pixels = np.asarray(pixels, dtype=float)
        wanted_x, wanted_y = (pixels[..., 0] - self.cx) / self.fx, (pixels[..., 1] - self.cy) / self.fy
        x, y = wanted_x, wanted_y
        if self.coefficients:
            radius = np.hypot(wanted_x, wanted_y)
            with np.errstate(all="ignore"):
                # the radial part's own inverse, then both parts' by Newton's method
                scale = np.where(radius > 0, self._radial.inverse(radius) / np.where(radius > 0, radius, 1), 1.0)
                x, y = self._undistorted(wanted_x, wanted_y, x * scale, y * scale)
        return Rays(np.zeros((*x.shape, 3)), unit(np.stack([x, y, np.ones_like(x)], axis=-1)))

    def _undistorted(
        self, wanted_x: np.ndarray, wanted_y: np.ndarray, x: np.ndarray, y: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the x and y whose distorted places are wanted, from a first guess; NaN where Newton's method fails."""
        # the tangential terms can put a place next to the limit beyond the radial part's inverse
        edge = 0.99 * self._radial.limit
        radius = np.hypot(wanted_x, wanted_y)
        lost = ~np.isfinite(x) & np.isfinite(radius)
        if np.isfinite(edge) and lost.any():
            x, y = (np.where(lost, w * edge / radius, now) for w, now in ((wanted_x, x), (wanted_y, y)))
        for _ in range(NEWTON_STEPS):
            moved_x, moved_y, (a, b, c, d) = self._distorted(x, y)
            miss_x, miss_y, determinant = moved_x - wanted_x, moved_y - wanted_y, a * d - b * c
            step_x, step_y = (d * miss_x - b * miss_y) / determinant, (a * miss_y - c * miss_x) / determinant
            x, y = x - step_x, y - step_y
            if not np.nanmax(np.hypot(step_x, step_y), initial=0.0) > 1e-15:
                break
        moved_x, moved_y, _ = self._distorted(x, y)
        near = np.hypot(moved_x - wanted_x, moved_y - wanted_y) < 1e-10 * (1 + radius)
        good = near & (np.hypot(x, y) < self._radial.limit)
        return np.where(good, x, np.nan), np.where(good, y, np.nan)

    def _distorted(
        self, x: np.ndarray, y: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
        """Return x', y' and their derivatives dx'/dx, dx'/dy, dy'/dx, dy'/dy."""
        k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = self._terms
        q = x * x + y * y
        top, bottom = 1 + q * (k1 + q * (k2 + q * k3)), 1 + q * (k4 + q * (k5 + q * k6))
        radial = top / bottom
        slope = (k1 + q * (2 * k2 + 3 * k3 * q) - radial * (k4 + q * (2 * k5 + 3 * k6 * q))) / bottom  # by r^2
        new_x = x * radial + 2 * p1 * x * y + p2 * (q + 2 * x * x) + q * (s1 + q * s2)
        new_y = y * radial + p1 * (q + 2 * y * y) + 2 * p2 * x * y + q * (s3 + q * s4)
        thin_x, thin_y = 2 * (s1 + 2 * s2 * q), 2 * (s3 + 2 * s4 * q)
        both = 2 * (x * y * slope + p1 * x + p2 * y)
        return new_x, new_y, (
            radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x + x * thin_x,
            both + y * thin_x,
            both + x * thin_y,
            radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x + y * thin_y,
        )  # fmt: skip
