"""What a rover reports of itself, whichever dynamics moves it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class RoverState:
    """Where the rover is and how it moves. World x east, y north, z up; body x forward, y left, z up.

    position: (3,) [m] of the body origin, on the ground under the middle. pose: (4, 4) body to world.
    roll, pitch, yaw [rad]: pose = Rz(yaw) Ry(pitch) Rx(roll), so that pitch > 0 is nose down, roll > 0 right side down.
    velocity: (3,) [m/s] of the body origin, in the body frame. yaw_rate [rad/s] about the body's z.
    """

    position: np.ndarray
    pose: np.ndarray
    roll: float
    pitch: float
    yaw: float
    velocity: np.ndarray
    yaw_rate: float

    @property
    def tilt(self) -> float:
        """Angle between the body's z and the vertical [rad]."""
        return float(np.arccos(np.clip(self.pose[2, 2], -1.0, 1.0)))


@dataclass(frozen=True)
class Contacts:
    """What the rover touched during its last motion.

    chassis: the chassis box touches ground or rock. obstacle: a wheel touches a rock that stands at least
    RoverSpec.obstacle_height out of the ground.
    """

    chassis: bool = False
    obstacle: bool = False

    @property
    def collision(self) -> bool:
        """Whether either of them does."""
        return self.chassis or self.obstacle


def rotation(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """(3, 3) Rz(yaw) Ry(pitch) Rx(roll)."""
    cr, sr, cp, sp, cy, sy = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch), np.cos(yaw), np.sin(yaw)
    return np.array([
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ])  # fmt: skip


def angles(matrix: np.ndarray) -> tuple[float, float, float]:
    """roll, pitch, yaw [rad] of a (3, 3) rotation; the inverse of rotation() for |pitch| < 90 deg."""
    return (
        float(np.arctan2(matrix[2, 1], matrix[2, 2])),
        float(np.arcsin(np.clip(-matrix[2, 0], -1.0, 1.0))),
        float(np.arctan2(matrix[1, 0], matrix[0, 0])),
    )


def state_of(pose: np.ndarray, velocity: np.ndarray, yaw_rate: float) -> RoverState:
    """RoverState of a (4, 4) pose; velocity (3,) in the body frame."""
    roll, pitch, yaw = angles(pose[:3, :3])
    return RoverState(pose[:3, 3].copy(), pose.copy(), roll, pitch, yaw, np.asarray(velocity, dtype=float), yaw_rate)
