"""MarsNav-v0 for a small policy: how free the ways around the goal's direction are, and which of them to take.

A policy on images needs millions of steps; this one sees 36 numbers and chooses among 13 ways. Their directions count
from the goal's direction, not from the rover's heading, so that "straight on if that is free, else the nearest free
way" is the same answer wherever the rover looks (the polar histogram of VFH: Borenstein and Koren 1991). A way is held
for some steps (an option of fixed length: Sutton, Precup and Singh 1999): one draw tries a detour, instead of ten draws
that happen to agree, and its outcome is a few choices away.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from envs.drivers.steering import head_for
from envs.mars_nav import MarsNavEnv
from envs.observation.map_view import CELL, PIXELS
from envs.observation.spaces import check_observations, share_of_distance
from envs.world.action import ActionError
from marssim.base.angle import wrapped
from marssim.base.images.distance_transform import euclidean_distance
from marssim.base.rover_spec import RoverSpec

HALF_FAN = np.pi / 2  # [rad] to either side of the goal's direction: the range of the ways
WAYS = 13  # number of ways, 15 deg apart
AHEAD = WAYS // 2  # number of the way straight to the goal
REACH = 5.0  # [m] length over which a way is checked
MARGIN = -0.1  # [m] added to half the rover's width: the map shows obstacles too large by about a cell
HOLD_STEPS = 3  # steps for which a way is held: 1.2 m
TURN_IN_PLACE = 0.5  # [rad] that the rover turns in one step; arcs up to it leave a straight path by 0.1 m
OBSERVATION_SIZE = 2 * WAYS + 3 + 6 + 1  # numbers: ways and their room, goal, state, last way
_OFFSETS = np.linspace(HALF_FAN, -HALF_FAN, WAYS)
_ALONG = np.arange(1, round(REACH / CELL) + 1) * CELL
_ROOM_CELLS = round(2.0 / CELL)  # cells of a way over which its room is measured
ROOM = 1.5  # [m] beyond which more room makes no difference


class Corridors(gymnasium.Wrapper, gymnasium.utils.RecordConstructorArgs):
    """Vectors for a multilayer perceptron instead of images, on a MarsNavEnv that was made with map_observation=True.

    Observation `Box((36,), float32)`:

    | Index | Meaning                                                                                     |
    |-------|---------------------------------------------------------------------------------------------|
    | 0-12  | free length / 5 m of the ways at 90, 75, ... -90 deg from the goal's direction, left > 0    |
    | 13-25 | least distance from an obstacle on the first 2 m of these ways / 1.5 m                      |
    | 26-28 | distance / (distance + 5 m) of the goal; sine and cosine of its bearing from the heading    |
    | 29-34 | MarsNav-v0's `state`                                                                        |
    | 35    | direction of the last way from the goal's direction / 90 deg, left > 0; 0 at first          |

    Action `Discrete(13)`: which of these ways to take for three steps of MarsNav-v0. The reward is the sum of theirs.
    The rover turns in place while the way is more than 0.5 rad off its heading; otherwise it drives there at full
    speed.
    """

    def __init__(self, env: gymnasium.Env) -> None:
        gymnasium.utils.RecordConstructorArgs.__init__(self)
        gymnasium.Wrapper.__init__(self, env)
        check_observations(env, "Corridors", with_map=True)
        self.observation_space = corridor_space()
        self.action_space = spaces.Discrete(WAYS)
        self._goal = np.array([0.0, 0.0, 1.0])

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode; the arguments are those of MarsNavEnv.reset."""
        observation, info = self.env.reset(seed=seed, options=options)
        return self._to_vector(observation, AHEAD), info

    def step(self, action: int) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Take a way for HOLD_STEPS steps, or until the episode ends.

        Args:
            action: Number of the way.

        Returns:
            Observation, sum of the rewards, whether the episode is terminated, whether it is truncated, and the info.

        Raises:
            ActionError: There is no such way.
        """
        if not self.action_space.contains(action):
            raise ActionError(f"action must be the number of a way, 0 to {WAYS - 1}, got {action!r:.60}")
        env = self.unwrapped
        assert isinstance(env, MarsNavEnv) and env.action_space.shape is not None
        total = 0.0
        for _ in range(HOLD_STEPS):
            drive = steer(self._goal, int(action), env.rover_spec)
            observation, reward, terminated, truncated, info = self.env.step(drive[: env.action_space.shape[0]])
            self._goal = observation["goal"]
            total += float(reward)
            if terminated or truncated:
                break
        return self._to_vector(observation, int(action)), total, terminated, truncated, info

    def _to_vector(self, observation: dict[str, Any], last: int) -> np.ndarray:
        env = self.unwrapped
        assert isinstance(env, MarsNavEnv)
        self._goal = observation["goal"]
        return as_corridors(observation, env.rover_spec, last)


def corridor_space() -> spaces.Box:
    """Return the observation space of Corridors."""
    return spaces.Box(-np.inf, np.inf, (OBSERVATION_SIZE,), np.float32)


def as_corridors(observation: dict[str, Any], spec: RoverSpec, last: int = AHEAD) -> np.ndarray:
    """Return one observation of MarsNav-v0 as Corridors shows it.

    Args:
        observation: The observation, with its map.
        spec: The rover.
        last: Number of the way that was taken last.

    Returns:
        (36,) float32.
    """
    distance, sine, cosine = observation["goal"]
    cost, bearing = _without_own_ground(observation["map"][1], spec), float(np.arctan2(sine, cosine))
    free, room = look_along(cost, bearing + _OFFSETS, spec.width / 2 + MARGIN)
    goal = [share_of_distance(distance), sine, cosine]
    last_way = [_OFFSETS[last] / HALF_FAN]
    return np.concatenate([free / REACH, room / ROOM, goal, observation["state"], last_way]).astype(np.float32)


def _without_own_ground(cost: np.ndarray, spec: RoverSpec) -> np.ndarray:
    """Return the cost (64, 64) with no obstacle in cells under the rover: the ground there carries it."""
    middles = (PIXELS / 2 - 0.5 - np.arange(PIXELS)) * CELL
    under = (np.abs(middles) < spec.length / 2)[:, None] & (np.abs(middles) < spec.width / 2)
    return np.where(under, 0, cost)


def look_along(cost: np.ndarray, bearings: np.ndarray, half_width: float) -> tuple[np.ndarray, np.ndarray]:
    """Measure the straight ways from the rover.

    A rover that stands nearer to an obstacle than half_width may go wherever it comes no nearer, until its way is as
    far from all obstacles as half_width.

    Args:
        cost: (64, 64) cost of MarsNav-v0's map, 1 at obstacles.
        bearings: (n,) directions of the ways from the heading [rad], positive to the left.
        half_width: Half the width of the corridor [m].

    Returns:
        (n,) free lengths [m], at most REACH, and (n,) least distances from an obstacle on the first 2 m [m], at most
        ROOM.
    """
    ahead, left = np.outer(np.cos(bearings), _ALONG), np.outer(np.sin(bearings), _ALONG)
    row, column = (np.floor(PIXELS / 2 - part / CELL).astype(int) for part in (ahead, left))
    free = (cost < 1).astype(np.uint8)
    if free.all():
        return np.full(len(bearings), REACH), np.full(len(bearings), ROOM)
    clearance = euclidean_distance(free) * CELL - CELL / 2
    middle = slice(PIXELS // 2 - 1, PIXELS // 2 + 1)  # the rover stands at the corner of four cells
    near = clearance[row, column]
    away = np.maximum.accumulate(near >= half_width, axis=1)
    hit = near < np.where(away, half_width, min(half_width, float(clearance[middle, middle].min())))
    length = np.where(hit.any(axis=1), hit.argmax(axis=1) * CELL, REACH)
    return length, np.clip(near[:, :_ROOM_CELLS].min(axis=1), 0, ROOM)


def steer(goal: np.ndarray, way: int, spec: RoverSpec) -> np.ndarray:
    """Return the action of MarsNav-v0 that takes a way, as Corridors documents it.

    Args:
        goal: (3,) the goal as MarsNav-v0 observes it.
        way: Number of the way.
        spec: The rover.

    Returns:
        (3,) action.
    """
    _, sine, cosine = goal
    bearing = float(np.arctan2(sine, cosine) + _OFFSETS[way])
    return head_for(wrapped(bearing), TURN_IN_PLACE, spec)
