"""Turn a body motion into six wheel speeds and six steering angles.

Body frame: x forward, y left, z up. Wheel order as in RoverSpec.wheel_positions: front left, front right, middle left,
middle right, rear left, rear right. All six wheels steer, so every wheel rolls along the velocity of the rigid body at
its hub: v_i = (v_x - w y_i, v_y + w x_i) (double Ackermann; a point turn is v = 0, a crab is w = 0).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from marssim.base.rover_spec import ZHURONG, RoverSpec


@dataclass(frozen=True)
class WheelCommand:
    """The speeds and angles of the six wheels, in the order of RoverSpec.wheel_positions."""

    speeds: np.ndarray
    """(6,) wheel speeds [rad/s], positive rolls forward."""
    angles: np.ndarray
    """(6,) steering angles [rad], positive to the left."""


def wheel_command(speed: float, yaw_rate: float, spec: RoverSpec = ZHURONG, lateral: float = 0.0) -> WheelCommand:
    """Return the wheel speeds and steering angles of a planar body motion.

    The motion is scaled down as a whole, so that it keeps its curve, until speed, yaw rate and wheel speeds are within
    `spec`. A wheel points backwards and turns in reverse where that keeps its angle within spec.max_steer.

    Args:
        speed: Forward speed [m/s], negative backwards.
        yaw_rate: Yaw rate [rad/s], positive to the left.
        spec: The rover.
        lateral: Speed to the left [m/s].

    Returns:
        The wheel command; wheels straight and at rest for no motion.

    Raises:
        ValueError: If an input is not finite, or if the motion needs a steering angle beyond spec.max_steer.
    """
    if not np.isfinite([speed, yaw_rate, lateral]).all():
        raise ValueError(f"speed, yaw_rate and lateral must be finite, got {speed}, {yaw_rate}, {lateral}")
    hubs = spec.wheel_positions[:, :2]
    scale = min(
        1.0,
        spec.max_speed / max(np.hypot(speed, lateral), 1e-12),
        spec.max_yaw_rate / max(abs(yaw_rate), 1e-12),
    )
    vx = (speed - yaw_rate * hubs[:, 1]) * scale
    vy = (lateral + yaw_rate * hubs[:, 0]) * scale
    ground_speed = np.hypot(vx, vy)
    moving = ground_speed > 1e-9
    # Straight ahead is preferred to straight back: of the two angles that roll the same way, the smaller one.
    forward = np.where(vx >= -1e-12, 1.0, -1.0)
    angles = np.where(moving, np.arctan2(vy * forward, vx * forward), 0.0)
    if np.abs(angles).max() > spec.max_steer + 1e-9:
        worst = np.rad2deg(np.abs(angles).max())
        raise ValueError(
            f"speed={speed:.3f}, yaw_rate={yaw_rate:.3f}, lateral={lateral:.3f} needs {worst:.0f} deg of steering, "
            f"the limit is {np.rad2deg(spec.max_steer):.0f} deg"
        )
    speeds = np.where(moving, forward * ground_speed, 0.0) / spec.wheel_radius
    fastest = np.abs(speeds).max()
    if fastest > spec.max_wheel_speed:
        speeds *= spec.max_wheel_speed / fastest
    return WheelCommand(speeds, angles)


def point_turn(yaw_rate: float, spec: RoverSpec = ZHURONG) -> WheelCommand:
    """Return the wheel command of a turn on the spot.

    Args:
        yaw_rate: Yaw rate [rad/s], positive to the left.
        spec: The rover.
    """
    return wheel_command(0.0, yaw_rate, spec)


def crab(speed: float, direction: float, spec: RoverSpec = ZHURONG) -> WheelCommand:
    """Return the wheel command of a drive along a body direction without turning.

    Args:
        speed: Speed [m/s].
        direction: Direction of the motion [rad] from x, positive to the left.
        spec: The rover.
    """
    return wheel_command(speed * np.cos(direction), 0.0, spec, lateral=speed * np.sin(direction))


def tightest_radius(spec: RoverSpec = ZHURONG) -> float:
    """Return the least radius [m] of a drive along a curve: on a tighter one, a wheel needs more than spec.max_steer.

    Args:
        spec: The rover.
    """
    return float(np.max(np.abs(spec.wheel_positions[:, 1]) + _steering_reach(spec)))


def steerable(speed: float, yaw_rate: float, spec: RoverSpec = ZHURONG) -> tuple[float, float]:
    """Return the drivable motion that is nearest to the requested one, within the limits of speed and steering.

    A curve whose turning centre is too near to a wheel needs more than spec.max_steer. It becomes the tightest curve
    that does not: the yaw rate is kept and the speed raised or lowered; where that would exceed the speed limit, the
    yaw rate is lowered instead.

    Args:
        speed: Forward speed [m/s], negative backwards.
        yaw_rate: Yaw rate [rad/s], positive to the left.
        spec: The rover.

    Returns:
        The speed [m/s] and the yaw rate [rad/s].
    """
    speed = float(np.clip(speed, -spec.max_speed, spec.max_speed))
    yaw_rate = float(np.clip(yaw_rate, -spec.max_yaw_rate, spec.max_yaw_rate))
    if yaw_rate == 0.0:
        return speed, yaw_rate
    radius = speed / yaw_rate
    low, high = float(np.min(np.abs(spec.wheel_positions[:, 1]) - _steering_reach(spec))), tightest_radius(spec)
    if low < abs(radius) < high:
        # A drive becomes a wider drive; a motion near a point turn becomes a tighter turn.
        wanted = high if abs(radius) > (low + high) / 2 else max(low, 0.0)
        if wanted * abs(yaw_rate) > spec.max_speed:
            yaw_rate *= spec.max_speed / (wanted * abs(yaw_rate))
        speed = float(np.sign(speed) * wanted * abs(yaw_rate))
    return speed, yaw_rate


def _steering_reach(spec: RoverSpec) -> np.ndarray:
    """Return how far the turning centre must lie from each wheel, to its left or right [m]: (6,)."""
    # Wheel i at (x, y): |w x| <= tan(max_steer) |v - w y|, hence radius v / w at least this far from each y.
    return np.asarray(np.abs(spec.wheel_positions[:, 0]) / np.tan(spec.max_steer))
