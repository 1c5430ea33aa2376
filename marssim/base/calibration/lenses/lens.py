"""What every lens model can do: project points to pixels, and return the rays of pixels.

Convention: the camera's frame has x to the right, y down and z forward (OpenCV), and its origin at the camera's centre.
Pixels are (u, v), column and row; pixel centres are integers, the first is (0, 0). All arithmetic is in float64. What
a lens cannot see is NaN: points behind it, and points beyond the angle from which on the model folds back into the
image, as polynomials of distortion do outside of the calibrated field of view.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Rays:
    """Rays of pixels, in the camera's frame.

    Attributes:
        origin: (..., 3) a point of each ray [m]. It is 0 for all models but CAHVORE, whose entrance pupil moves.
        direction: (..., 3) unit vectors; NaN for pixels that show nothing.
    """

    origin: np.ndarray
    direction: np.ndarray

    def at(self, distance: float | np.ndarray) -> np.ndarray:
        """Return (..., 3) the points at a distance [m] along the rays."""
        return self.origin + np.asarray(distance)[..., None] * self.direction


class Lens(ABC):
    """A lens model, with the pixels of its detector."""

    @abstractmethod
    def project(self, points: np.ndarray) -> np.ndarray:
        """Return the pixels that show points.

        Args:
            points: (..., 3) [m], camera frame. A lens without entrance pupil terms takes directions too.

        Returns:
            (..., 2) float64 column and row [px]; NaN where the lens does not see the point.
        """

    @abstractmethod
    def rays(self, pixels: np.ndarray) -> Rays:
        """Return the rays of pixels, the inverse of project.

        Args:
            pixels: (..., 2) column and row [px].
        """

    @abstractmethod
    def focal(self) -> float:
        """Return the focal length at the optical axis [px], the geometric mean of both directions."""


def split(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return x, y and z of (..., 3) points, float64."""
    points = np.asarray(points, dtype=float)
    return points[..., 0], points[..., 1], points[..., 2]


def unit(vectors: np.ndarray) -> np.ndarray:
    """Return (..., 3) vectors with length 1."""
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
