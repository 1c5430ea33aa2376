"""The image planes of rays that start in an eye or are parallel to the sun's.

A projection maps a world point p to (X, Y, W, S) = axes p + shift. (X / W, Y / W) is the image point, and W > 0 in
front. S grows along the ray: an eye has W = S = z; the sun has W = 1 and S = the depth below it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

NEAREST = 1e-3  # [m] least distance from an eye at which its rays hit anything


@dataclass(frozen=True)
class Projection:
    """A projection, see above.

    Attributes:
        axes: (4, 3) matrix.
        shift: (4,) vector.
        nearest: Least S at which a ray hits anything.
        away: Sign of the determinant of the corners (X, Y, W) of a triangle that is turned away from the eye or sun.
    """

    axes: np.ndarray
    shift: np.ndarray
    nearest: float
    away: float

    @property
    def numbers(self) -> tuple[float, ...]:
        """The axes row by row, then the shift: 16 numbers, for kernels."""
        return (*self.axes.ravel().tolist(), *self.shift.tolist())

    @classmethod
    def of_eye(cls, pose: np.ndarray) -> Projection:
        """Return the projection of a camera at pose (4, 4), camera to world: the image plane is z = 1, and S = z."""
        axes = pose[:3, :3].T[[0, 1, 2, 2]]
        return cls(np.ascontiguousarray(axes), -axes @ pose[:3, 3], NEAREST, 1.0)

    @classmethod
    def of_sun(cls, sun: np.ndarray) -> Projection:
        """Return the projection along the unit vector `sun` (3,): S is minus the height towards the sun."""
        helper = np.array([0.0, 0.0, 1.0]) if abs(sun[2]) < 0.9 else np.array([0.0, 1.0, 0.0])
        right = np.cross(helper, sun)
        right /= np.linalg.norm(right)
        axes = np.stack([right, np.cross(sun, right), np.zeros(3), -sun])
        return cls(axes, np.array([0.0, 0.0, 1.0, 0.0]), -np.inf, -1.0)
