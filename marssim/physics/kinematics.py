"""The rover on the surface without dynamics: how it rests, what it hits, and how it moves along an arc.

Settling solves the six contact equations of the rocker-bogie: height, roll, pitch, differential and two bogie angles
follow from six wheel heights. It is a fixed-point iteration with the level rover's Jacobian, whose inverse has a closed
form.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from marssim.base.rover_spec import ZHURONG, RoverSpec
from marssim.physics.body import Part, rover_parts
from marssim.physics.linkage import MAX_SWING, Joints, Linkage
from marssim.physics.state import Contacts, RoverState, rotation, state_of
from marssim.physics.support import SupportMap
from marssim.scene.scene import Scene

ITERATIONS = 8  # most iterations of settling
TOLERANCE = 5e-4  # [m] largest gap between a wheel and its support that ends the iteration
SUBSTEP = 0.1  # [s] between two collision checks along an arc
SETTLE_EVERY = 5  # substeps between two checks of the belly


@dataclass(frozen=True)
class Settled:
    """A rover at rest.

    Attributes:
        pose: (4, 4) body to world.
        roll: [rad], as in RoverState.
        pitch: [rad], as in RoverState.
        yaw: [rad], as in RoverState.
        joints: Angles of the joints.
        wheel_heights: (6,) z of the wheel centres [m].
        wheel_contacts: (6, 2) x and y of a point at which each wheel rests on ground or rock [m].
        wheel_middles: (6, 2) x and y of the middle of the wheel's width as far along the wheel [m].
        clearance: Least height of the chassis' underside above ground or rock [m]; negative where they overlap.
        residual: Largest gap between a wheel and its support [m]. It exceeds TOLERANCE only where a joint is at its
            stop or a wheel on an edge.
    """

    pose: np.ndarray
    roll: float
    pitch: float
    yaw: float
    joints: Joints
    wheel_heights: np.ndarray
    wheel_contacts: np.ndarray
    wheel_middles: np.ndarray
    clearance: float
    residual: float

    @property
    def belly_contact(self) -> bool:
        """Whether the chassis rests on ground or rock."""
        return self.clearance <= 0


@dataclass(frozen=True)
class _Footprint:
    """Sample points of a rover's underside, in the body frame [m].

    Attributes:
        linkage: The rover's joints.
        wheel: (K, 2) points along and across a wheel.
        crown: (K,) height of the wheel's centre above the ground when the wheel touches it at that point.
        patches: (M, 2) points of the six wheels, seen from above.
        belly: (B, 3) points of the chassis' underside.
    """

    linkage: Linkage
    wheel: np.ndarray
    crown: np.ndarray
    patches: np.ndarray
    belly: np.ndarray


@lru_cache(maxsize=8)
def _footprint(spec: RoverSpec) -> _Footprint:
    r, half = spec.wheel_radius, spec.wheel_width / 2
    along = r * np.sin(np.linspace(-1, 1, 11) * np.deg2rad(80))  # denser at the ends, where the wheel is steep
    across = np.linspace(-half, half, 5)
    wheel = np.stack([g.ravel() for g in np.meshgrid(along, across)], axis=1)
    ends = np.stack([g.ravel() for g in np.meshgrid(np.linspace(-r, r, 7), across)], axis=1)
    length, width, _ = spec.chassis_size
    nx, ny = int(np.ceil(length / 0.05)) + 1, int(np.ceil(width / 0.05)) + 1
    bx, by = np.meshgrid(np.linspace(-length / 2, length / 2, nx), np.linspace(-width / 2, width / 2, ny))
    return _Footprint(
        linkage=Linkage.from_spec(spec),
        wheel=wheel,
        crown=np.sqrt(r**2 - wheel[:, 0] ** 2),
        patches=(spec.wheel_positions[:, None, :2] + ends).reshape(-1, 2),
        belly=np.stack([bx.ravel(), by.ravel(), np.full(bx.size, spec.belly_clearance)], axis=1),
    )


def support_of(surface: Scene | SupportMap, spec: RoverSpec = ZHURONG) -> SupportMap:
    """Return the surface itself if it is a SupportMap, else build the map of the scene; keep it for further calls."""
    return surface if isinstance(surface, SupportMap) else SupportMap.from_scene(surface, spec.obstacle_height)


def settle(surface: Scene | SupportMap, spec: RoverSpec, x: float, y: float, yaw: float) -> Settled:
    """Put the rover down and let it come to rest.

    Every wheel is a cylinder along the heading that rests on the highest point of ground and climbable rocks under it.
    Obstacles do not lift wheels; `collides` tells where the rover would hit one.

    Args:
        surface: The scene, or its map.
        spec: The rover.
        x: East coordinate of the body origin [m].
        y: North coordinate [m].
        yaw: Heading [rad], counter-clockwise from east.

    Raises:
        ValueError: The place is outside the finely gridded square, or the heading is not finite.
    """
    if not math.isfinite(yaw):
        raise ValueError(f"yaw must be finite [rad], got {yaw}")
    support, shape = support_of(surface, spec), _footprint(spec)
    if not support.contains(x, y):
        raise ValueError(f"x={x:.2f}, y={y:.2f} is outside the scene's fine square")
    linkage = shape.linkage
    front, middle, rear = spec.wheel_x
    rocker_lever, bogie_lever = front - (middle + rear) / 2, middle - rear
    forward = np.array([np.cos(yaw), np.sin(yaw)])
    offsets = shape.wheel @ np.array([forward, [-forward[1], forward[0]]])
    roll, pitch, differential, bogie = 0.0, 0.0, 0.0, np.zeros(2)
    z = float(support.sample(support.drive, np.array(x), np.array(y)))
    step, best = 1.0, np.inf
    for count in range(ITERATIONS):
        rocker = np.array([differential, -differential])
        turn = rotation(roll, pitch, yaw)
        hubs = linkage.hub_positions(rocker, bogie) @ turn.T + (x, y, z)
        under = hubs[:, None, :2] + offsets
        lifted = support.sample(support.drive, under[..., 0], under[..., 1]) + shape.crown
        heights = lifted.max(axis=1)
        gap = heights - hubs[:, 2]
        worst = float(np.abs(gap).max())
        if worst < TOLERANCE or count == ITERATIONS - 1:
            break
        step = step if worst < 0.7 * best else 0.6 * step  # wheels at an edge oscillate between two supports
        best = min(best, worst)
        mean = gap.reshape(3, 2).mean(axis=0)
        lift = (gap[2:4] + gap[4:6]) / 2
        nose = -(gap[0:2] - lift) / rocker_lever  # [rad] by which each rocker has to turn
        bow = -(gap[2:4] - gap[4:6]) / bogie_lever
        z += step * float(mean.mean())
        roll += step * float(mean[0] - mean[1]) / spec.track
        pitch += step * float(nose.mean())
        differential = float(np.clip(differential + step * (nose[0] - nose[1]) / 2, -MAX_SWING, MAX_SWING))
        bogie = np.clip(bogie + step * (bow - nose), -MAX_SWING, MAX_SWING)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, (x, y, z)
    belly = shape.belly @ turn.T + (x, y, z)
    clearance = float((belly[:, 2] - support.sample(support.top, belly[:, 0], belly[:, 1])).min())
    touching = lifted.argmax(axis=1)
    contacts = under[np.arange(6), touching]
    middles = hubs[:, :2] + shape.wheel[touching, :1] * forward
    joints = Joints(rocker, bogie)
    return Settled(pose, roll, pitch, yaw, joints, hubs[:, 2], contacts, middles, clearance, worst)


def collides(surface: SupportMap, spec: RoverSpec, x: float, y: float, yaw: float) -> Contacts:
    """Return which parts of a level rover at x, y [m], yaw [rad] are in an obstacle: the chassis, a wheel's outline."""
    shape = _footprint(spec)
    c, s = np.cos(yaw), np.sin(yaw)
    turn = np.array([[c, s], [-s, c]])
    wheels = shape.patches @ turn + (x, y)
    wheel = bool(surface.nearest(surface.obstacle, wheels[:, 0], wheels[:, 1]).any())
    belly = shape.belly[:, :2] @ turn + (x, y)
    blocked = surface.nearest(surface.obstacle, belly[:, 0], belly[:, 1])
    if not blocked.any():
        return Contacts(obstacle=wheel)
    px, py = belly[blocked].T
    middle = surface.sample(surface.ground, np.array(x), np.array(y))
    chassis = bool((surface.sample(surface.top, px, py) - middle).max() > spec.belly_clearance)
    return Contacts(chassis, wheel)


class KinematicRover:
    """The rover without dynamics: it follows its commands exactly, settles, and stops before an obstacle.

    It has the methods of `marssim.physics.rover.Rover` except for `drive`: it takes speed and yaw rate instead of wheel
    speeds.
    """

    def __init__(
        self,
        scene: Scene,
        spec: RoverSpec,
        x: float,
        y: float,
        yaw: float,
        support: SupportMap | None = None,
    ) -> None:
        """Put the rover down at rest.

        Args:
            scene: The scene.
            spec: The rover.
            x: East coordinate of the body origin [m].
            y: North coordinate [m].
            yaw: Heading [rad], counter-clockwise from east.
            support: The scene's map, if it has been built already.

        Raises:
            ValueError: The place is outside the finely gridded square, or a number is not finite.
        """
        self.spec = spec
        self.support = support or support_of(scene, spec)
        self._settled = settle(self.support, spec, x, y, yaw)
        self._twist = (0.0, 0.0, 0.0)
        self._travelled, self._stopped = 0.0, False  # [s] of the last motion, and whether something ended it early
        self._spin = np.zeros(6)
        self._steering = np.zeros(6)
        hit = collides(self.support, spec, x, y, yaw)
        self._contacts = Contacts(chassis=hit.chassis or self._settled.belly_contact, obstacle=hit.obstacle)

    def drive_twist(self, speed: float, yaw_rate: float, seconds: float, lateral: float = 0.0) -> RoverState:
        """Follow an arc, and stop where a wheel or the chassis would hit something, where the rover tilts beyond
        spec.max_tilt, or at the scene's edge.

        Args:
            speed: Forward speed [m/s]; it is not clipped.
            yaw_rate: Yaw rate [rad/s], positive to the left; it is not clipped.
            seconds: Duration [s].
            lateral: Speed to the left [m/s].

        Returns:
            The state at the end.

        Raises:
            ValueError: A number is not finite, or the duration is negative.
        """
        if not np.isfinite([speed, yaw_rate, seconds, lateral]).all() or seconds < 0:
            raise ValueError(
                f"drive_twist needs finite speeds and a finite time of 0 or more, got speed={speed}, "
                f"yaw_rate={yaw_rate}, seconds={seconds}, lateral={lateral}"
            )
        substeps = max(1, int(np.ceil(seconds / SUBSTEP - 1e-9)))
        start, current = self._settled, self._settled
        self._contacts, travelled, settled, stopped = Contacts(), 0.0, 0.0, True
        for n in range(1, substeps + 1):
            t = seconds * n / substeps
            x, y, yaw = along_arc(start, speed, yaw_rate, t, lateral)
            if not self.support.contains(x, y):
                break
            hit = collides(self.support, self.spec, x, y, yaw)
            if hit.collision:
                self._contacts = hit
                break
            travelled = t
            if n % SETTLE_EVERY == 0 or n == substeps:
                current, settled = settle(self.support, self.spec, x, y, yaw), t
                self._contacts = Contacts(chassis=current.belly_contact)
                if current.belly_contact or state_of(current.pose, np.zeros(3), 0.0).tilt > self.spec.max_tilt:
                    break
        else:
            stopped = False
        if settled < travelled:
            current = settle(self.support, self.spec, *along_arc(start, speed, yaw_rate, travelled, lateral))
        self._settled, self._travelled, self._stopped = current, travelled, stopped
        self._twist = (0.0, 0.0, 0.0) if stopped else (speed, lateral, yaw_rate)
        self._turn_wheels(speed, yaw_rate, travelled, lateral)
        return self.state()

    def state(self) -> RoverState:
        """Return where the rover is. Its velocity is that of the last command, or zero if it was stopped."""
        speed, lateral, yaw_rate = self._twist
        return state_of(self._settled.pose, np.array([speed, lateral, 0.0]), yaw_rate)

    def contacts(self) -> Contacts:
        """Return what stopped the last motion, if anything did."""
        return self._contacts

    def joints(self) -> Joints:
        """Return the angles of all joints [rad]."""
        settled = self._settled.joints
        return Joints(settled.rocker, settled.bogie, self._steering, self._spin)

    def mesh(self, pan: float = 0.0) -> list[Part]:
        """Return the parts to draw the rover from outside; pan: pan of the mast [rad], positive to the left."""
        return rover_parts(self.spec, self._settled.pose, self.joints(), pan)

    def close(self) -> None:
        """Do nothing; it exists so that both dynamics can be closed."""

    def _turn_wheels(self, speed: float, yaw_rate: float, seconds: float, lateral: float = 0.0) -> None:
        hubs = self.spec.wheel_positions
        vx, vy = speed - yaw_rate * hubs[:, 1], lateral + yaw_rate * hubs[:, 0]
        forward = np.where(vx >= 0, 1.0, -1.0)
        steered = yaw_rate or lateral
        self._steering = np.arctan2(vy * forward, np.maximum(vx * forward, 1e-12)) if steered else np.zeros(6)
        self._spin = self._spin + forward * np.hypot(vx, vy) * seconds / self.spec.wheel_radius


def along_arc(
    start: Settled, speed: float, yaw_rate: float, t: float, lateral: float = 0.0
) -> tuple[float, float, float]:
    """Return x, y [m] and yaw [rad] after t seconds of constant speed and yaw rate along the ground, from a settled
    pose; lateral: speed to the left [m/s]."""
    x, y = start.pose[:2, 3]
    turn = yaw_rate * t
    bend = np.sinc(turn / 2 / np.pi)
    chord, side = speed * t * np.cos(start.pitch) * bend, lateral * t * np.cos(start.roll) * bend
    c, s = np.cos(start.yaw + turn / 2), np.sin(start.yaw + turn / 2)
    return float(x + (chord * c - side * s)), float(y + (chord * s + side * c)), start.yaw + turn
