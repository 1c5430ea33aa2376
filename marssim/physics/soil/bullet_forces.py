"""Soil under the wheels of a rover in PyBullet: forces of the tables in place of Coulomb's friction with the ground.

PyBullet keeps the wheels on the surface and drives over rocks with its own friction. On the ground, it knows no
friction here: before each step, each wheel is pushed by what the soil does to it at its present slip. Its grip is
that of the load that PyBullet puts on the ground under it: a wheel that rests on a rock too has less, and one in the
air has none. The forces are those at the end of the step (implicit Euler), as friction that builds up within a few mm/s
would shake the rover otherwise.
"""

from __future__ import annotations

import numpy as np

from marssim.physics.soil.slippage import Slippage
from marssim.physics.soil.soil_map import GroundName
from marssim.physics.soil.traction import Grip, Traction
from marssim.physics.world import PhysicsWorld

REFRESH = 12  # steps for which the grip of the wheels is taken as constant: 1 cm at full speed
STILL = 1e-3  # [m/s] speed of a rim below which its wheel stands


class SoilForces:
    """Pushes the wheels of one rover in a PhysicsWorld, and sums up what its drive costs."""

    def __init__(
        self,
        world: PhysicsWorld,
        body: int,
        wheels: list[int],
        steers: list[int],
        middle: np.ndarray,
        ground: GroundName,
    ) -> None:
        """Push the wheels from now on, on ground that has no friction (PhysicsWorld.note_rover).

        Args:
            world: The world of the rover.
            body: PyBullet's id of the rover.
            wheels: Its wheel joints, in the order of marssim.physics.linkage.WHEELS.
            steers: Its steering joints, likewise.
            middle: (3,) middle of the chassis in the body frame [m], which is the origin of PyBullet's body.
            ground: "scene" for the scene's own soils, or the soil that lies everywhere instead.
        """
        self._world, self._p, self._client = world, world.bullet, world.client
        self._wheel_of = {joint: wheel for wheel, joint in enumerate(wheels)}
        self._body, self._wheels, self._steers, self._middle = body, wheels, steers, middle
        self._traction = Traction(world.scene, world.spec, world.support, ground)
        yaw_inertia = self._yaw_inertia()
        self._inertia = np.array([world.spec.mass, world.spec.mass, yaw_inertia]) / world.time_step
        self._grip: Grip | None = None
        self._steps = 0
        self._borne = np.zeros(6)  # sums over the steps of the loads of the wheels that the ground bears [N]
        self.slippage = Slippage()
        self.apply()
        world.watch(self.is_at_rest, self.apply)

    def restart(self) -> None:
        """Begin a new drive."""
        self.slippage = Slippage()

    def is_at_rest(self) -> bool:
        """Leave it to the rover whether it rests."""
        return True

    def remove(self) -> None:
        """Stop pushing."""
        self._world.unwatch(self.is_at_rest, self.apply)

    def apply(self) -> None:
        """Push the wheels in the next step, and count the step for the sums of the drive."""
        p, client, radius = self._p, self._client, self._world.spec.wheel_radius
        position, quaternion = p.getBasePositionAndOrientation(self._body, physicsClientId=client)
        turn = np.array(p.getMatrixFromQuaternion(quaternion)).reshape(3, 3)
        self._borne += self._loads()
        if self._grip is None or self._steps % REFRESH == 0:
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = turn, np.array(position) - turn @ self._middle
            at = self._world.spec.wheel_positions @ turn.T + pose[:3, 3]
            loads = self._borne / REFRESH if self._steps else None
            self._grip = self._traction.grip(pose, self._traction.soils.at(at[:, 0], at[:, 1]), loads)
            self._borne = np.zeros(6)
        self._steps += 1
        linear, angular = p.getBaseVelocity(self._body, physicsClientId=client)
        spin = turn.T @ np.array(angular)
        velocity = turn.T @ np.array(linear) - np.cross(spin, self._middle)
        rims = self._rims(radius)
        motion = np.array([velocity[0], velocity[1], spin[2]])
        balance = self._traction.balance(self._grip, rims, self._inertia, motion)
        forces = balance.force @ turn[:, :2].T
        hubs = p.getLinkStates(self._body, self._wheels, physicsClientId=client)
        for wheel, hub, force in zip(self._wheels, hubs, forces):
            contact = (np.array(hub[0]) - radius * turn[:, 2]).tolist()
            p.applyExternalForce(self._body, wheel, force.tolist(), contact, p.WORLD_FRAME, physicsClientId=client)
        step = self._world.time_step
        self.slippage.add(balance, radius, step, step * turn[:2, :2] @ rims.mean(axis=0))

    def _yaw_inertia(self) -> float:
        """Return the rover's moment of inertia about the z axis of its body frame [kg m2], with its joints as now."""
        p, client = self._p, self._client
        origin, quaternion = p.getBasePositionAndOrientation(self._body, physicsClientId=client)
        axis = np.array(p.getMatrixFromQuaternion(quaternion)).reshape(3, 3)[:, 2]
        total = 0.0
        for link in range(-1, p.getNumJoints(self._body, physicsClientId=client)):
            mass, _, inertia, *_ = p.getDynamicsInfo(self._body, link, physicsClientId=client)
            at, turn = origin, quaternion
            if link >= 0:
                at, turn, *_ = p.getLinkState(self._body, link, physicsClientId=client)
            of_link = np.array(p.getMatrixFromQuaternion(turn)).reshape(3, 3).T @ axis
            total += inertia @ of_link**2 + mass * (np.cross(axis, np.subtract(at, origin)) ** 2).sum()
        return float(total)

    def _loads(self) -> np.ndarray:
        """Return the loads of the wheels that the ground bore in the last step, (6,) [N]."""
        out = np.zeros(6)
        touched = self._p.getContactPoints(bodyA=self._body, bodyB=self._world.ground, physicsClientId=self._client)
        for point in touched:
            wheel = self._wheel_of.get(point[3])
            if wheel is not None:
                out[wheel] += point[9]
        return out

    def _rims(self, radius: float) -> np.ndarray:
        """Return the velocities of the wheels' rims in the body frame, (6, 2) [m/s]."""
        steers = self._p.getJointStates(self._body, self._steers, physicsClientId=self._client)
        wheels = self._p.getJointStates(self._body, self._wheels, physicsClientId=self._client)
        angle, rate = np.array([s[0] for s in steers]), np.array([w[1] for w in wheels])
        speed = np.where(np.abs(rate) * radius > STILL, rate * radius, 0.0)
        return np.stack([speed * np.cos(angle), speed * np.sin(angle)], axis=1)
