"""The image planes of rays that meet in an eye or come from the sun.

A projection maps a world point p to (X, Y, W, S) = axes p + shift. (X / W, Y / W) is the image point, W > 0 in front.
S grows along the ray: an eye has W = S = z, the sun W = 1 and S = the depth below it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

NEAREST = 1e-3  # [m] what is nearer to an eye is not met


@dataclass(frozen=True)
class Projection:
    """axes: (4, 3), shift: (4,); see above. nearest: smallest S that is met.

    away: sign of the determinant of the corners (X, Y, W) of a triangle that is turned away from the eye or sun.
    """

    axes: np.ndarray
    shift: np.ndarray
    nearest: float
    away: float

    @property
    def numbers(self) -> tuple[float, ...]:
        """axes row by row, then shift: 16 numbers, for kernels."""
        return (*self.axes.ravel().tolist(), *self.shift.tolist())

    @classmethod
    def of_eye(cls, pose: np.ndarray) -> Projection:
        """Rays from the camera at pose (4, 4) to world; the image plane is z = 1, S is the depth."""
        axes = pose[:3, :3].T[[0, 1, 2, 2]]
        return cls(np.ascontiguousarray(axes), -axes @ pose[:3, 3], NEAREST, 1.0)

    @classmethod
    def of_sun(cls, sun: np.ndarray) -> Projection:
        """Rays along the unit vector `sun` (3,); S is minus the height towards it."""
        helper = np.array([0.0, 0.0, 1.0]) if abs(sun[2]) < 0.9 else np.array([0.0, 1.0, 0.0])
        right = np.cross(helper, sun)
        right /= np.linalg.norm(right)
        axes = np.stack([right, np.cross(sun, right), np.zeros(3), -sun])
        return cls(axes, np.array([0.0, 0.0, 1.0, 0.0]), -np.inf, -1.0)
