"""Smooth random fields over a scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

WAVES = 24  # plane waves in a field


@dataclass(frozen=True)
class Waves:
    """A random field with a mean of 0 and a variance of 1: the sum of plane waves.

    Attributes:
        vectors: (WAVES, 2) wave vectors [rad/m].
        phases: (WAVES,) phases [rad].
    """

    vectors: np.ndarray
    phases: np.ndarray

    @classmethod
    def draw(cls, shortest: float, longest: float, rng: np.random.Generator) -> Waves:
        """Draw a field whose wavelengths lie between two [m]."""
        length = np.exp(rng.uniform(np.log(shortest), np.log(longest), WAVES))
        angle = rng.uniform(0, 2 * np.pi, WAVES)
        vectors = (2 * np.pi / length)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        return cls(vectors, rng.uniform(0, 2 * np.pi, WAVES))

    def at(self, xy: np.ndarray) -> np.ndarray:
        """Return the field (N,) at points (N, 2) [m]."""
        return np.asarray(np.cos(xy @ self.vectors.T + self.phases).sum(axis=1) * np.sqrt(2 / WAVES))
