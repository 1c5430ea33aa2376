"""Who drives: the navigator, and the simplest drivers to compare it with."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from envs.mars_nav import STEP_SECONDS, MarsNavEnv
from envs.world.course import EDGE
from envs.world.referee import GOAL_RADIUS
from marssim.base.rover_spec import RoverSpec
from nav.navigator import Navigator

STRAIGHT_WITHIN = 0.3  # [rad] of the goal's direction the straight driver drives


class Stop(Enum):
    """Why a driver ends its drive by itself. The values are the outcomes that envs.drives.episodes records."""

    NO_PATH = "no_path"  # it finds no way on
    ARRIVED = "elsewhere"  # it believes to be at the goal; were it there, the drive had ended with the step before


class Driver(Protocol):
    """Chooses actions for a MarsNavEnv made with mast=True; with map_observation=True if `needs_map` is true of it."""

    def reset(self, env: MarsNavEnv, seed: int) -> None:
        """A new episode begins."""

    def act(self, env: MarsNavEnv, observation: dict[str, Any]) -> np.ndarray | Stop:
        """(3,) action in [-1, 1]: speed, yaw rate, pan; or a Stop, which ends the drive."""
        ...


class NavigatorDriver:
    """nav.Navigator, fed with what the environment's eyes saw."""

    def __init__(self) -> None:
        self.navigator = Navigator()

    def reset(self, env: MarsNavEnv, seed: int) -> None:
        assert env.course is not None
        reach = env.course.scene.half - EDGE
        self.navigator = Navigator(env.rover_spec, area=(-reach, -reach, reach, reach))  # the ground's edge is known

    def act(self, env: MarsNavEnv, observation: dict[str, Any]) -> np.ndarray | Stop:
        assert env.sight is not None and env.course is not None
        sight, spec = env.sight, env.rover_spec
        command = self.navigator.step(
            sight.depth, sight.confidence, sight.rig, env.believed_pose, env.course.goal, sight.pan
        )
        if command.over:
            return Stop.ARRIVED if command.status == "arrived" else Stop.NO_PATH
        pan = command.pan or 0.0
        action = [command.speed / spec.max_speed, command.yaw_rate / spec.max_yaw_rate, pan / spec.mount.pan_limit]
        return np.clip(np.array(action, dtype=np.float32), -1, 1)


class StraightDriver:
    """Turns to the goal and drives straight at it, blind, until it believes to be there."""

    def reset(self, env: MarsNavEnv, seed: int) -> None: ...

    def act(self, env: MarsNavEnv, observation: dict[str, Any]) -> np.ndarray | Stop:
        distance, sine, cosine = observation["goal"]
        if distance <= GOAL_RADIUS / 2:
            return Stop.ARRIVED
        return head_for(float(np.arctan2(sine, cosine)), STRAIGHT_WITHIN, env.rover_spec)


def head_for(bearing: float, within: float, spec: RoverSpec) -> np.ndarray:
    """(3,) action of MarsNav-v0 that turns to a bearing and drives at full speed once it is ahead.

    bearing: from the heading, in [-pi, pi] [rad], left > 0; within [rad]: of straight ahead the rover drives while it
    turns, else it turns in place.
    """
    yaw_rate = np.clip(bearing / (spec.max_yaw_rate * STEP_SECONDS), -1, 1)
    return np.array([abs(bearing) < within, yaw_rate, 0.0], dtype=np.float32)


class RandomDriver:
    """Uniform random actions."""

    def reset(self, env: MarsNavEnv, seed: int) -> None:
        self._rng = np.random.default_rng((seed, 1))  # not the stream that draws the course

    def act(self, env: MarsNavEnv, observation: dict[str, Any]) -> np.ndarray:
        return self._rng.uniform(-1, 1, 3).astype(np.float32)


DRIVERS: dict[str, type[Driver]] = {
    "navigator": NavigatorDriver,
    "straight": StraightDriver,
    "random": RandomDriver,
}


def make_driver(name: str) -> Driver:
    """A driver by name, from a policy file (.zip, see policy_files.py) or by class path, package.module:Class.

    Raises ValueError or FileNotFoundError that says what was expected.
    """
    if name in DRIVERS:
        return DRIVERS[name]()
    from envs.drivers.policy_files import PolicyDriver, load_driver_class

    if name.endswith(".zip"):
        return PolicyDriver(Path(name))
    if ":" in name:
        return load_driver_class(name)
    raise ValueError(f"driver {name!r} is unknown; choose from {', '.join(DRIVERS)}, FILE.zip, package.module:Class")
