"""A six-wheel rocker-bogie rover in a PhysicsWorld: motors, brakes, differential and contacts."""

from __future__ import annotations

import os
import tempfile

import numpy as np
import scipy

from marssim.physics.body import Part, rover_parts
from marssim.physics.kinematics import settle
from marssim.physics.linkage import SIDES, WHEELS, Joints
from marssim.physics.soil.bullet_forces import SoilForces
from marssim.physics.soil.soil_map import GroundName, check_ground
from marssim.physics.state import Contacts, RoverState, state_of
from marssim.physics.urdf import chassis_middle, rover_urdf
from marssim.physics.world import PhysicsWorld

WHEEL_FRICTION = 0.9  # friction coefficient, times the ground's 1.0: grousers on firm ground; friction angle 42 deg
STEER_TORQUE = 120.0  # [N m] largest torque of a steering motor
STEER_RATE = 1.5  # [rad/s] largest steering rate
STEER_WAIT = float(np.deg2rad(8.0))  # [rad] error of a steering angle above which the wheels stand still
PARK_AFTER = 0.5  # [s] after which static friction holds a rover that is braked and slower than PARK_SPEED
PARK_SPEED = 0.015  # [m/s] mean speed: contacts creep more slowly, and a slide is faster at once
SETTLE_TIME = 0.3  # [s] in which the springs of the contacts come to rest after the rover is put down


class Rover:
    """The rover of world.spec. Wheels are in the order of WHEELS: front left, front right, middle left, ..."""

    def __init__(self, world: PhysicsWorld, x: float, y: float, yaw: float, ground: GroundName | None = None) -> None:
        """Put the rover down at rest.

        Args:
            world: The world that it is added to.
            x: East coordinate of the body origin [m].
            y: North coordinate [m].
            yaw: Heading [rad], counter-clockwise from east.
            ground: None for ground that does not yield. Else the wheels slip and sink: on "scene" for the scene's own
                soils, or on the soil of this name everywhere.

        Raises:
            ValueError: The place is outside the fine square, there is no such ground, or a rover in this world slips
                where this one does not, or the other way round. Nothing has been added to the world then.
        """
        if ground is not None:
            check_ground(ground)
        self.world, self.spec = world, world.spec
        self._p, self._client = world.bullet, world.client
        self._contacts = Contacts()
        self._speeds, self._steering = np.zeros(6), np.zeros(6)
        self._moving, self._parked = True, False
        self._still_since = 0.0
        self._still_at: np.ndarray | None = None
        settled = settle(world.support, self.spec, x, y, yaw)
        world.note_rover(ground is not None)
        self._to_middle = np.array([0.0, 0.0, chassis_middle(self.spec)])
        self._body = self._load(settled.pose)
        self._index = self._joint_indices()
        self._wheels = [self._index[f"wheel_{name}"] for name in WHEELS]
        self._steers = [self._index[f"steer_{name}"] for name in WHEELS]
        self._free_joints(settled.joints)
        self.soil: SoilForces | None = None
        if ground is not None:
            self.soil = SoilForces(world, self._body, self._wheels, self._steers, self._to_middle, ground)
        self.drive(np.zeros(6), np.zeros(6))
        world.watch(self._update, self._record_contacts)
        world.step(SETTLE_TIME)

    def drive(self, wheel_speeds: np.ndarray, steering: np.ndarray) -> None:
        """Set the targets of the motors, clipped to the rover's limits.

        The wheels wait until the steering angles are nearly reached; at zero speed they brake.

        Args:
            wheel_speeds: (6,) [rad/s], positive forward.
            steering: (6,) [rad], positive to the left.

        Raises:
            ValueError: An array has another shape or a number that is not finite.
        """
        speeds, angles = np.asarray(wheel_speeds, dtype=float), np.asarray(steering, dtype=float)
        shapes = speeds.shape == angles.shape == (6,)
        if not (shapes and np.isfinite(speeds).all() and np.isfinite(angles).all()):
            raise ValueError(f"drive needs 6 finite speeds and 6 finite angles, got {speeds} and {angles}")
        limit = self.spec.max_wheel_speed
        self._speeds = np.clip(speeds, -limit, limit)
        self._steering = np.clip(angles, -self.spec.max_steer, self.spec.max_steer)
        for joint, angle in zip(self._steers, self._steering.tolist()):
            self._p.setJointMotorControl2(
                self._body, joint, self._p.POSITION_CONTROL, targetPosition=angle, force=STEER_TORQUE,
                maxVelocity=STEER_RATE, positionGain=0.3, velocityGain=1.0, physicsClientId=self._client,
            )  # fmt: skip
        self._contacts = Contacts()
        if self.soil is not None:
            self.soil.restart()
        self._wake()
        self._brake()
        self.world.check_rest()

    def state(self) -> RoverState:
        """Return where the rover is and how it moves."""
        pose = self._pose()
        if self._parked:
            return state_of(pose, np.zeros(3), 0.0)
        linear, angular = self._p.getBaseVelocity(self._body, physicsClientId=self._client)
        turn = pose[:3, :3]
        spin = np.array(angular)
        velocity = turn.T @ (np.array(linear) - np.cross(spin, turn @ self._to_middle))
        return state_of(pose, velocity, float(spin @ turn[:, 2]))

    def contacts(self) -> Contacts:
        """Return what the rover has touched since the last `drive`."""
        return self._contacts

    def joints(self) -> Joints:
        """Return the angles of all joints [rad]."""
        rocker, bogie = ([self._angle(f"{kind}_{side}") for side in SIDES] for kind in ("rocker", "bogie"))
        steering, spin = ([self._angle(f"{kind}_{name}") for name in WHEELS] for kind in ("steer", "wheel"))
        return Joints(np.array(rocker), np.array(bogie), np.array(steering), np.array(spin))

    def mesh(self, pan: float = 0.0) -> list[Part]:
        """Return the parts to draw the rover from outside; pan: pan of the mast [rad], positive to the left."""
        return rover_parts(self.spec, self._pose(), self.joints(), pan)

    def remove(self) -> None:
        """Take the rover out of its world, which stays open. Do not use the rover afterwards."""
        self._p.removeBody(self._body, physicsClientId=self._client)
        self.world.unwatch(self._update, self._record_contacts)
        if self.soil is not None:
            self.soil.remove()
        self.world.forget_rover()

    def close(self) -> None:
        """Close the world that the rover is in."""
        self.world.close()

    def _load(self, pose: np.ndarray) -> int:
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "rover.urdf")
            with open(path, "w", encoding="utf-8") as file:
                file.write(rover_urdf(self.spec))
            return self._p.loadURDF(
                path,
                (pose[:3, 3] + pose[:3, :3] @ self._to_middle).tolist(),
                _quaternion(pose[:3, :3]),
                # without the second flag a cylinder becomes a prism of 32 sides, which is slow and rolls roughly
                flags=self._p.URDF_USE_INERTIA_FROM_FILE | self._p.URDF_USE_IMPLICIT_CYLINDER,
                physicsClientId=self._client,
            )

    def _joint_indices(self) -> dict[str, int]:
        count = self._p.getNumJoints(self._body, physicsClientId=self._client)
        infos = (self._p.getJointInfo(self._body, j, physicsClientId=self._client) for j in range(count))
        return {info[1].decode(): info[0] for info in infos}

    def _free_joints(self, joints: Joints) -> None:
        """Let rockers and bogies swing freely from their settled angles, and couple the rockers by a differential."""
        p, client = self._p, self._client
        for kind, values in (("rocker", joints.rocker), ("bogie", joints.bogie)):
            for side, angle in zip(SIDES, values):
                joint = self._index[f"{kind}_{side}"]
                p.resetJointState(self._body, joint, float(angle), physicsClientId=client)
                p.setJointMotorControl2(self._body, joint, p.VELOCITY_CONTROL, force=0, physicsClientId=client)
                p.changeDynamics(self._body, joint, jointDamping=4.0, physicsClientId=client)
        left, right = (self._index[f"rocker_{side}"] for side in SIDES)
        gear = p.createConstraint(
            self._body, left, self._body, right, p.JOINT_GEAR, [0, 1, 0], [0, 0, 0], [0, 0, 0], physicsClientId=client
        )
        # v_left + ratio v_right = 0; erp pulls the sum of the angles back to zero
        p.changeConstraint(gear, gearRatio=1, maxForce=5000, erp=0.2, relativePositionTarget=0, physicsClientId=client)
        for link in (-1, *range(p.getNumJoints(self._body, physicsClientId=client))):
            p.changeDynamics(
                self._body, link, lateralFriction=WHEEL_FRICTION, restitution=0, linearDamping=0, angularDamping=0,
                physicsClientId=client,
            )  # fmt: skip

    def _update(self) -> bool:
        """Release or hold the wheels; return whether the rover is parked."""
        if self._speeds.any():
            states = self._p.getJointStates(self._body, self._steers, physicsClientId=self._client)
            ready = max(abs(s[0] - target) for s, target in zip(states, self._steering)) < STEER_WAIT
            if ready and not self._moving:
                self._roll()
            elif not ready and self._moving:
                self._brake()
        elif not self._parked:
            self._park_if_still()
        self._record_contacts()
        return self._parked

    def _park_if_still(self) -> None:
        """Park a braked rover once it rests: Bullet has no static friction and would let it creep."""
        elapsed = self.world.time - self._still_since
        if self._still_at is not None and elapsed < PARK_AFTER:
            return
        position, previous = self._pose()[:3, 3], self._still_at
        self._still_since, self._still_at = self.world.time, position
        if previous is not None:
            speed = np.linalg.norm(position - previous) / elapsed
            self._parked = bool(speed < PARK_SPEED)

    def _wake(self) -> None:
        self._parked = False
        self._still_since, self._still_at = self.world.time, None

    def _roll(self) -> None:
        self._moving = True
        for joint, speed in zip(self._wheels, self._speeds.tolist()):
            self._p.setJointMotorControl2(
                self._body, joint, self._p.VELOCITY_CONTROL, targetVelocity=speed, force=self.spec.wheel_torque,
                velocityGain=1.0, physicsClientId=self._client,
            )  # fmt: skip

    def _brake(self) -> None:
        """Hold every wheel at its angle: a motor with a target speed of zero would creep under load."""
        self._moving = False
        states = self._p.getJointStates(self._body, self._wheels, physicsClientId=self._client)
        for joint, state in zip(self._wheels, states):
            self._p.setJointMotorControl2(
                self._body, joint, self._p.POSITION_CONTROL, targetPosition=state[0], force=self.spec.wheel_torque,
                positionGain=0.2, velocityGain=1.0, physicsClientId=self._client,
            )  # fmt: skip

    def _record_contacts(self) -> None:
        """Record what is touched.

        This runs after every step, so it asks only for the contact points of chassis and obstacles. Those of all six
        wheels would take three times as long.
        """
        if self._parked:
            return
        points, body, client = self._p.getContactPoints, self._body, self._client
        chassis = any(_pressed(p) for p in points(bodyA=body, linkIndexA=-1, physicsClientId=client))
        obstacle = any(
            _pressed(p) and p[3] != -1
            for rocks in self.world.obstacles
            for p in points(bodyA=body, bodyB=rocks, physicsClientId=client)
        )
        if chassis or obstacle:
            self._contacts = Contacts(chassis or self._contacts.chassis, obstacle or self._contacts.obstacle)

    def _pose(self) -> np.ndarray:
        position, quaternion = self._p.getBasePositionAndOrientation(self._body, physicsClientId=self._client)
        pose = np.eye(4)
        pose[:3, :3] = np.array(self._p.getMatrixFromQuaternion(quaternion)).reshape(3, 3)
        pose[:3, 3] = np.array(position) - pose[:3, :3] @ self._to_middle
        return pose

    def _angle(self, name: str) -> float:
        return self._p.getJointState(self._body, self._index[name], physicsClientId=self._client)[0]


def _pressed(point: tuple) -> bool:
    """Return whether a contact point of PyBullet bears a force; without one, the bodies are near but do not touch."""
    return point[9] > 0


def _quaternion(turn: np.ndarray) -> list[float]:
    """Return the quaternion x, y, z, w of a (3, 3) rotation."""
    return scipy.spatial.transform.Rotation.from_matrix(turn).as_quat().tolist()
