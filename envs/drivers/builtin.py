"""The navigator as a driver, and the simplest drivers to compare it with."""

from __future__ import annotations

from typing import Any

import numpy as np

from envs.drivers.driver import Stop
from envs.drivers.steering import head_for
from envs.mars_nav import MarsNavEnv
from envs.world.referee import GOAL_RADIUS
from nav.command import Command
from nav.config import NavigatorConfig
from nav.navigator import Navigator

STRAIGHT_WITHIN = 0.3  # [rad] from the goal's direction, within which the straight driver drives while it turns


class NavigatorDriver:
    """nav.Navigator, fed with the environment's depth.

    Args:
        config: The navigator's settings; None for NavigatorConfig.of_rover of the environment's rover.

    Attributes:
        navigator: The navigator.
        command: Its last command; None before the first.
    """

    def __init__(self, config: NavigatorConfig | None = None) -> None:
        self.config = config
        self.navigator = Navigator(config=config)
        self.command: Command | None = None

    def reset(self, env: MarsNavEnv, seed: int) -> None:
        assert env.course is not None
        # the navigator knows where the ground ends
        self.navigator, self.command = Navigator(env.rover_spec, self.config, env.course.area), None

    def act(self, env: MarsNavEnv, observation: dict[str, Any]) -> np.ndarray | Stop:
        assert env.sight is not None and env.course is not None
        sight, spec = env.sight, env.rover_spec
        command = self.command = self.navigator.step(
            sight.depth, sight.confidence, sight.rig, env.believed_pose, env.course.goal, env.gaze.pan,
            between_looks=not env.gaze.fresh,
        )  # fmt: skip
        if command.over:
            return Stop.ARRIVED if command.status == "arrived" else Stop.NO_PATH
        pan = command.pan or 0.0
        action = [command.speed / spec.max_speed, command.yaw_rate / spec.max_yaw_rate, pan / spec.mount.pan_limit]
        return np.clip(np.array(action, dtype=np.float32), -1, 1)


class StraightDriver:
    """Turns to the goal and drives straight at it, blind, until it believes that it is there."""

    def reset(self, env: MarsNavEnv, seed: int) -> None: ...

    def act(self, env: MarsNavEnv, observation: dict[str, Any]) -> np.ndarray | Stop:
        distance, sine, cosine = observation["goal"]
        if distance <= GOAL_RADIUS / 2:
            return Stop.ARRIVED
        return head_for(float(np.arctan2(sine, cosine)), STRAIGHT_WITHIN, env.rover_spec)


class RandomDriver:
    """Draws uniform random actions."""

    def reset(self, env: MarsNavEnv, seed: int) -> None:
        self._rng = np.random.default_rng((seed, 1))  # another stream than the one that draws the course

    def act(self, env: MarsNavEnv, observation: dict[str, Any]) -> np.ndarray:
        return self._rng.uniform(-1, 1, 3).astype(np.float32)
