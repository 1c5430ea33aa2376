"""CAHV, CAHVOR and CAHVORE, the camera models of the rovers of NASA.

Vectors in one frame: C the centre [m], A the axis (normal of the image plane, unit length), H and V [px], O the optical
axis (unit length), R the radial terms, E the entrance pupil terms [m]. Pixel centres are integers from (0, 0).

CAHV (Yakimovsky and Cunningham 1978), p = P - C:

    u = p . H / p . A,  v = p . V / p . A

CAHVOR and CAHVORE (Gennery 1993, 2006) move p first. With zeta = p . O, lambda = p - zeta O, and theta from

    zeta sin theta - |lambda| cos theta - (theta - sin theta) (E0 + E1 theta^2 + E2 theta^4) = 0

    chi = tan(L theta) / L  for L > 0,  theta  for L = 0,  sin(L theta) / L  for L < 0
    p' = (|lambda| / chi) O + (1 + R0 + R1 chi^2 + R2 chi^4) lambda

L is 1 for type 1 (perspective), 0 for type 2 (fisheye), and the model's parameter for type 3. CAHVOR is type 1 with E =
0, where chi = |lambda| / zeta; CAHV has R = 0 too. The entrance pupil of a pixel's ray lies at

    C + (theta / sin theta - 1) (E0 + E1 theta^2 + E2 theta^4) O
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from marssim.base.calibration.lenses.curve import MOST, RisingCurve
from marssim.base.calibration.lenses.lens import Lens, Rays, unit

Vector = tuple[float, float, float]
NEWTON_STEPS = 30
SMALL = 1e-9  # [rad] angles to the optical axis at which the model is CAHV
STRAIGHT = 1e-15  # |L| below which the lens is equidistant, as in JPL's own code


@dataclass(frozen=True)
class Cahvore(Lens):
    """A CAHV, CAHVOR or CAHVORE model in the camera's own frame, whose z axis is A and whose x axis lies along H.

    Attributes:
        a, h, v, o: The vectors A, H, V and O.
        r, e: The terms R and E.
        linearity: L, from the type and the parameter.
    """

    a: Vector
    h: Vector
    v: Vector
    o: Vector
    r: Vector = (0.0, 0.0, 0.0)
    e: Vector = (0.0, 0.0, 0.0)
    linearity: float = 1.0

    @cached_property
    def _radial(self) -> RisingCurve:
        bound = MOST if self.linearity > STRAIGHT else np.pi  # of chi
        if self.linearity < -STRAIGHT:
            bound = 1 / abs(self.linearity)
        return RisingCurve((1 + self.r[0], self.r[1], self.r[2]), most=bound)

    def focal(self) -> float:
        a, h, v = (np.array(x) for x in (self.a, self.h, self.v))
        return float(np.sqrt(np.linalg.norm(np.cross(a, h)) * np.linalg.norm(np.cross(a, v))))

    def project(self, points: np.ndarray) -> np.ndarray:
        points = np.asarray(points, dtype=float)
        o = np.array(self.o)
        zeta = points @ o
        side = points - zeta[..., None] * o
        length = np.linalg.norm(side, axis=-1)
        with np.errstate(all="ignore"):
            theta = self._theta(zeta, length)
            chi = self._chi(theta)
            radial = self._radial(chi) / np.where(chi > 0, chi, 1)  # 1 + R0 + R1 chi^2 + R2 chi^4
            moved = np.where(chi > 0, length / np.where(chi > 0, chi, 1), zeta)[..., None] * o
            moved = np.where((theta < SMALL)[..., None], points, moved + radial[..., None] * side)
            depth = moved @ np.array(self.a)
            depth = np.where(depth > 0, depth, np.nan)
            return np.stack([moved @ np.array(self.h) / depth, moved @ np.array(self.v) / depth], axis=-1)

    def rays(self, pixels: np.ndarray) -> Rays:
        pixels = np.asarray(pixels, dtype=float)
        a, h, v, o = (np.array(x) for x in (self.a, self.h, self.v, self.o))
        straight = np.cross(v - pixels[..., 1:] * a, h - pixels[..., :1] * a) / (a @ np.cross(v, h))
        zeta = straight @ o
        side = straight - zeta[..., None] * o
        length = np.linalg.norm(side, axis=-1)
        with np.errstate(all="ignore"):
            theta = self._from_chi(self._radial.inverse(length / np.where(zeta > 0, zeta, np.nan)))
            shift = np.where(theta > SMALL, theta / np.sin(theta) - 1, 0.0) * self._pupil(theta)
            across = side / np.where(length > 0, length, 1)[..., None]
            direction = np.sin(theta)[..., None] * across + np.cos(theta)[..., None] * o
        return Rays(np.where(np.isfinite(shift), shift, 0.0)[..., None] * o, unit(direction))

    def _pupil(self, theta: np.ndarray) -> np.ndarray:
        q = theta * theta
        return self.e[0] + q * (self.e[1] + q * self.e[2])

    def _theta(self, zeta: np.ndarray, length: np.ndarray) -> np.ndarray:
        """Return the angle of incidence (..., ) [rad] of points at zeta along O and length off it."""
        theta = np.arctan2(length, zeta)
        if not any(self.e):
            return theta
        for _ in range(NEWTON_STEPS):
            sine, cosine = np.sin(theta), np.cos(theta)
            slope = 2 * theta * (self.e[1] + 2 * self.e[2] * theta * theta)
            value = zeta * sine - length * cosine - (theta - sine) * self._pupil(theta)
            rise = zeta * cosine + length * sine - (1 - cosine) * self._pupil(theta) - (theta - sine) * slope
            step = value / rise
            theta = theta - step
            if not np.nanmax(np.abs(step), initial=0.0) > 1e-15:
                break
        return np.where(theta >= 0, theta, np.nan)

    def _chi(self, theta: np.ndarray) -> np.ndarray:
        l = self.linearity  # noqa: E741
        if abs(l) < STRAIGHT:
            return theta
        theta = np.where(theta * abs(l) < np.pi / 2, theta, np.nan)
        return (np.tan if l > 0 else np.sin)(l * theta) / l

    def _from_chi(self, chi: np.ndarray) -> np.ndarray:
        l = self.linearity  # noqa: E741
        if abs(l) < STRAIGHT:
            return chi
        return (np.arctan if l > 0 else np.arcsin)(l * chi) / l


def linearity_of(kind: float, parameter: float = 0.0) -> float:
    """Return L of a CAHVORE model.

    Args:
        kind: 1, 2 or 3.
        parameter: The model's parameter, which counts for type 3.

    Raises:
        ValueError: Another type, or a parameter out of [-1, 1].
    """
    if kind not in (1, 2, 3):
        raise ValueError(f"the type of a CAHVORE model must be 1, 2 or 3, is {kind:g}")
    if kind == 3 and not -1 <= parameter <= 1:
        raise ValueError(f"the parameter of a CAHVORE model of type 3 must be -1 to 1, is {parameter:g}")
    return {1: 1.0, 2: 0.0, 3: parameter}[int(kind)]
