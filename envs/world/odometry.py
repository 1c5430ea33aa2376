"""The rover's belief of its own pose: its true motion with the accumulated errors of dead reckoning."""

from __future__ import annotations

import numpy as np


class Odometry:
    """Dead reckoning that drifts.

    Attitude and height are measured well (inertial unit, sun); position and heading are not. Where wheels slip, the way
    that they turn without moving the rover is counted too, unless it is measured.

    Attributes:
        drift: Standard deviation of the position's error along each axis after 1 m [m]. It grows with the root of the
            way: 0.02 is 2 cm along each axis after 1 m and 9 cm after 20 m.
        yaw_drift: Standard deviation of the heading's error after 1 m [rad]; it grows likewise.
    """

    def __init__(self, drift: float, yaw_drift: float, rng: np.random.Generator) -> None:
        self.drift, self.yaw_drift = drift, yaw_drift
        self._rng = rng
        self._true: np.ndarray | None = None
        self._xy, self._yaw_error = np.zeros(2), 0.0

    def update(self, pose: np.ndarray, slipped: np.ndarray | None = None) -> np.ndarray:
        """Return the believed pose after a move.

        Args:
            pose: (4, 4) true pose, body to world. The first one is believed as it is.
            slipped: (2,) way in the move that is counted, as the wheels turned, but was not made, world frame [m].

        Returns:
            (4, 4) believed pose, body to world.
        """
        position = pose[:2, 3]
        if self._true is None:
            self._xy = position.copy()
        else:
            move = position - self._true
            way = float(np.hypot(*move))
            if way > 0:
                self._yaw_error += self.yaw_drift * np.sqrt(way) * float(self._rng.normal())
                error = self.drift * np.sqrt(way) * self._rng.normal(size=2)
                self._xy = self._xy + _turn(self._yaw_error) @ move + error
            if slipped is not None:
                self._xy = self._xy + _turn(self._yaw_error) @ slipped
        self._true = position.copy()
        believed = pose.copy()
        believed[:2, :3] = _turn(self._yaw_error) @ pose[:2, :3]
        believed[:2, 3] = self._xy
        return believed


def _turn(angle: float) -> np.ndarray:
    """Return the (2, 2) rotation by an angle [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])
