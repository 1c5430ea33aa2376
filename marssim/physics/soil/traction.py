"""The grip of a rover's wheels on a scene's soils, and the motion that it allows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from marssim.base.rover_spec import RoverSpec
from marssim.physics.soil.balance import balanced_motion
from marssim.physics.soil.loads import wheel_loads
from marssim.physics.soil.soil_map import GroundName, SoilMap, on_rock
from marssim.physics.soil.soils import SOIL_NAMES
from marssim.physics.soil.tables import SLIPS, wheel_table
from marssim.physics.support import SupportMap
from marssim.physics.world import GRAVITY
from marssim.scene.scene import Scene

ROCK = SOIL_NAMES.index("bedrock")
NO_INERTIA = np.zeros(3)


@dataclass(frozen=True, eq=False)
class Grip:
    """What the six wheels find under them; S is the number of slips in the tables."""

    pull: np.ndarray
    """(6, S) drawbar pull less that without slip [N]; it does not fall with the slip."""
    side: np.ndarray
    """(6,) factor of this pull against a sideways slide."""
    resistance: np.ndarray
    """(6,) force with which the soil holds back a wheel that does not slip [N]."""
    torque: np.ndarray
    """(6, S) torque of the motors [N m]."""
    sinkage: np.ndarray
    """(6, S) sinkage of the wheels [m]."""
    weight: np.ndarray
    """(3,) weight of the rover in the body frame [N]."""


@dataclass(frozen=True, eq=False)
class Balance:
    """How the rover moves with turning wheels."""

    motion: np.ndarray
    """(3,) velocity of the body origin in the body frame [m/s], x and y, and yaw rate [rad/s]."""
    rims: np.ndarray
    """(6, 2) velocities of the rims [m/s]."""
    slip: np.ndarray
    """(6,) speed with which the wheels slide over the ground, over that of their rims."""
    force: np.ndarray
    """(6, 2) force of the soil on the wheels in the body frame [N]."""
    torque: np.ndarray
    """(6,) torque of the motors [N m]."""
    sinkage: np.ndarray
    """(6,) sinkage of the wheels [m]."""
    hub_velocities: np.ndarray
    """(6, 2) velocities of the wheels' hubs in the body frame [m/s]."""


class Traction:
    """The soils of a scene under the wheels of a rover."""

    def __init__(self, scene: Scene, spec: RoverSpec, support: SupportMap, ground: GroundName = "scene") -> None:
        """Compute the tables of the wheels and the map of the soils.

        Args:
            scene: The scene.
            spec: The rover.
            support: The rasters of the scene, which tell where rocks are.
            ground: "scene" for the scene's own soils, or the soil that lies everywhere instead. Rocks stay rocks.
        """
        self.spec, self.support = spec, support
        self.soils = SoilMap.from_scene(scene, ground)
        self._hubs = np.ascontiguousarray(spec.wheel_positions[:, :2])
        size = spec.wheel_radius, spec.wheel_width, spec.mass * GRAVITY
        self._tables = [wheel_table(name, *size) for name in SOIL_NAMES]

    def soils_under(self, middles: np.ndarray, contacts: np.ndarray) -> np.ndarray:
        """Return the shares of the soils (N, 3) under wheels; a rock counts as bedrock.

        Args:
            middles: (N, 2) x and y of the middles of their widths [m], where the soil is that of the ground.
            contacts: (N, 2) x and y of the points that touch [m], each of which may lie on a rock.
        """
        rock = np.arange(len(SOIL_NAMES)) == ROCK
        return np.where(on_rock(self.support, *contacts.T)[:, None], rock, self.soils.at(*middles.T))

    def grip(self, pose: np.ndarray, soils: np.ndarray, loads: np.ndarray | None = None) -> Grip:
        """Return what the wheels find under them.

        Args:
            pose: (4, 4) body to world.
            soils: (6, 3) shares of the soils under the wheels, as of `soils_under`.
            loads: (6,) loads of the wheels that these bear [N]; None for those of a rover at rest, as of `wheel_loads`.
        """
        weight = -self.spec.mass * GRAVITY * pose[2, :3]
        if loads is None:
            loads = wheel_loads(self.spec, weight)
        pull, torque, sinkage = np.zeros((3, 6, len(SLIPS)))
        side = np.ones(6)
        for table, share in zip(self._tables, soils.T):
            if share.any():
                pull, torque, sinkage = np.stack([pull, torque, sinkage]) + table.at(loads) * share[:, None]
                side = side + (table.side_at(loads) - 1) * share
        rising = np.maximum.accumulate(pull - pull[:, :1], axis=1)
        return Grip(rising, side, np.maximum(-pull[:, 0], 0), torque, sinkage, weight)

    def rims(self, speed: float, yaw_rate: float, lateral: float = 0.0) -> np.ndarray:
        """Return the velocities of the rims (6, 2) [m/s] of wheels that are steered and turn for a motion.

        Args:
            speed: Forward speed [m/s].
            yaw_rate: Yaw rate [rad/s].
            lateral: Speed to the left [m/s].
        """
        return _velocities(self._hubs, np.array([speed, lateral, yaw_rate]))

    def balance(
        self, grip: Grip, rims: np.ndarray, inertia: np.ndarray = NO_INERTIA, start: np.ndarray | None = None
    ) -> Balance:
        """Return how the rover moves.

        Args:
            grip: What its wheels find under them.
            rims: (6, 2) velocities of the rims [m/s].
            inertia: (3,) inertia over the time step, as of `balanced_motion`; without, the motion is quasi-static.
            start: (3,) motion at the start of the time step; None for that of the rims.
        """
        first = np.array([*rims.mean(axis=0), 0.0]) if start is None else start
        push = np.array([grip.weight[0], grip.weight[1], 0.0])
        motion, slip, force = balanced_motion(
            self._hubs, rims, grip.pull, grip.side, grip.resistance, push, inertia, first
        )
        hubs = _velocities(self._hubs, motion)
        torque = np.array([np.interp(at, SLIPS, of_wheel) for at, of_wheel in zip(slip, grip.torque)])
        sinkage = np.array([np.interp(at, SLIPS, of_wheel) for at, of_wheel in zip(slip, grip.sinkage)])
        # a wheel that slides forwards or sideways thrusts less than one that slides back by as much
        slide = rims - hubs
        scale = np.hypot(*rims.T) * np.hypot(*slide.T)
        ahead = np.where(scale > 1e-9, (rims * slide).sum(axis=1) / np.maximum(scale, 1e-9), 0.0)
        torque = grip.torque[:, 0] + (torque - grip.torque[:, 0]) * ahead
        return Balance(motion, rims, slip, force, torque, sinkage, hubs)


def _velocities(hubs: np.ndarray, motion: np.ndarray) -> np.ndarray:
    """Return the velocities (6, 2) of points (6, 2) of a body in plane motion (3,)."""
    return motion[:2] + motion[2] * np.stack([-hubs[:, 1], hubs[:, 0]], axis=1)
