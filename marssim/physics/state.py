"""The state and the contacts that a rover reports, with either dynamics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class RoverState:
    """Where the rover is and how it moves.

    World frame: x east, y north, z up. Body frame: x forward, y left, z up. The rotation of the pose is
    Rz(yaw) Ry(pitch) Rx(roll).

    Attributes:
        position: (3,) body origin [m], on the ground under the rover's middle.
        pose: (4, 4) body to world.
        roll: [rad], positive with the right side down.
        pitch: [rad], positive with the nose down.
        yaw: [rad], counter-clockwise from east.
        velocity: (3,) velocity of the body origin in the body frame [m/s].
        yaw_rate: Rotation about the body's z [rad/s].
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

    Attributes:
        chassis: The chassis touched ground or rock.
        obstacle: A wheel touched a rock whose exposed height is at least RoverSpec.obstacle_height.
    """

    chassis: bool = False
    obstacle: bool = False

    @property
    def collision(self) -> bool:
        """Whether the chassis or an obstacle was touched."""
        return self.chassis or self.obstacle


def rotation(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Return the (3, 3) rotation Rz(yaw) Ry(pitch) Rx(roll); angles [rad]."""
    cr, sr, cp, sp, cy, sy = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch), np.cos(yaw), np.sin(yaw)
    return np.array([
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ])  # fmt: skip


def angles(matrix: np.ndarray) -> tuple[float, float, float]:
    """Return roll, pitch and yaw [rad] of a (3, 3) rotation. Inverse of `rotation` for |pitch| < 90 deg."""
    return (
        float(np.arctan2(matrix[2, 1], matrix[2, 2])),
        float(np.arcsin(np.clip(-matrix[2, 0], -1.0, 1.0))),
        float(np.arctan2(matrix[1, 0], matrix[0, 0])),
    )


def state_of(pose: np.ndarray, velocity: np.ndarray, yaw_rate: float) -> RoverState:
    """Return the RoverState of a pose (4, 4), velocity (3,) in the body frame [m/s] and yaw rate [rad/s]."""
    roll, pitch, yaw = angles(pose[:3, :3])
    return RoverState(pose[:3, 3].copy(), pose.copy(), roll, pitch, yaw, np.asarray(velocity, dtype=float), yaw_rate)
