"""Odd polynomials of distortion, from 0 to where they turn back, and their inverse."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial import Polynomial

NEWTON_STEPS = 30
NODES = 513  # of the table from which Newton's method starts
MOST = 100.0  # largest t; as a tangent it is that of 89.4 deg
NEGLIGIBLE = 1e-9  # share of 1 below which a term is left out, even at the largest t


@dataclass(frozen=True)
class RisingCurve:
    """The curve f(t) = t (c0 + c1 t^2 + c2 t^4 + ...) / (1 + d1 t^2 + d2 t^4 + ...) from 0 to where it stops rising.

    Attributes:
        numerator: c0, c1, ...
        denominator: d1, d2, ...
        most: Largest t that is meant.
    """

    numerator: tuple[float, ...]
    denominator: tuple[float, ...] = ()
    most: float = MOST

    @cached_property
    def _fraction(self) -> tuple[Polynomial, Polynomial]:
        odd = np.zeros(2 * len(self.numerator))
        odd[1::2] = self.numerator
        even = np.zeros(2 * len(self.denominator) + 1)
        even[0], even[2::2] = 1.0, self.denominator
        return Polynomial(odd), Polynomial(even)

    @cached_property
    def limit(self) -> float:
        """The least t > 0 at which the curve turns back or has a pole, at most `most`; 0 if it never rises."""
        if not self.numerator[0] > 0:
            return 0.0
        top, bottom = self._fraction
        slope = top.deriv() * bottom - top * bottom.deriv()
        ends = [float(self.most)]
        for polynomial in (slope, bottom):
            counts = np.nonzero(np.abs(polynomial.coef) * self.most ** np.arange(len(polynomial.coef)) > NEGLIGIBLE)[0]
            roots = Polynomial(polynomial.coef[: max(counts, default=0) + 1]).roots()
            real = roots.real[np.abs(roots.imag) < 1e-9 * (1 + np.abs(roots))]
            ends.extend(real[real > 0])
        return float(min(ends))

    def __call__(self, t: np.ndarray) -> np.ndarray:
        """Return f(t); NaN outside of [0, limit)."""
        top, bottom = self._fraction
        t = np.where((t >= 0) & (t < self.limit), t, np.nan)
        return top(t) / bottom(t)

    def inverse(self, values: np.ndarray) -> np.ndarray:
        """Return the t in [0, limit) with f(t) = values; NaN where there is none."""
        values = np.asarray(values, dtype=float)
        top, bottom = self._fraction
        slope = (top.deriv() * bottom - top * bottom.deriv(), bottom * bottom)
        t = self._start(values)
        with np.errstate(all="ignore"):
            for _ in range(NEWTON_STEPS):
                step = (top(t) / bottom(t) - values) * slope[1](t) / slope[0](t)
                t = np.clip(t - step, 0, np.nextafter(self.limit, 0))
                if not np.nanmax(np.abs(step), initial=0.0) > 1e-15 * (1 + np.nanmax(t, initial=0.0)):
                    break
            wrong = ~(np.abs(top(t) / bottom(t) - values) <= 1e-9 * (1 + np.abs(values)))
        return np.where(wrong | (values < 0), np.nan, t)

    def _start(self, values: np.ndarray) -> np.ndarray:
        """Return t to a part in a hundred or so, from tables, each of which goes twice as far as the one before."""
        end = min(1.0, self.limit)
        largest = np.nanmax(values, initial=0.0)
        while end < self.limit and self(np.array(end)) < largest:
            end = min(2 * end, self.limit)
        nodes = np.linspace(0, np.nextafter(end, 0), NODES)
        return np.interp(values, self(nodes), nodes)
