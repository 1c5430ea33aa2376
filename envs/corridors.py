"""MarsNav-v0 for a small policy: what lies in the ways round the goal's direction, and which of them to take.

A policy on images needs millions of steps; this one sees 37 numbers and answers one. Its ways are told from the goal's
direction, not from the rover's heading, so that "straight on if that is free, else the nearest free way" is the same
answer wherever the rover looks (the polar histogram of VFH: Borenstein and Koren 1991).
"""

from __future__ import annotations

from typing import Any

import cv2
import gymnasium
import numpy as np
from gymnasium import spaces

from envs.ends import GOAL_RADIUS
from envs.map_view import CELL, PIXELS
from envs.mars_nav import STEP_SECONDS, MarsNavEnv
from marssim.rover_spec import RoverSpec

SWING = np.pi / 2  # [rad] to either side of the goal's direction: the ways that are looked along and can be taken
WAYS = 13  # every 15 deg
REACH = 5.0  # [m] they are looked along
MARGIN = -0.1  # [m] beside the rover: the map shows obstacles larger than they are, by about a cell
OPEN = 2.5  # [m] a way that is free so far is worth taking
TURN_IN_PLACE = 0.5  # [rad] what the rover turns in one step; straight ways are left by 0.1 m on the arcs up to it
_OFFSETS = np.linspace(-SWING, SWING, WAYS)
_ALONG = np.arange(1, round(REACH / CELL) + 1) * CELL
_NEAR = round(2.0 / CELL)  # steps over which the room is told
ROOM = 1.5  # [m] more of it makes no difference


class Corridors(gymnasium.Wrapper):
    """Vectors for a multilayer perceptron instead of images. Goes on a MarsNavEnv made with map_observation=True.

    Observation `Box((37,), float32)`:

    | Index | Meaning                                                                                     |
    |-------|---------------------------------------------------------------------------------------------|
    | 0-12  | free way / 5 m at -90, -75, ... 90 deg from the goal's direction, left > 0                  |
    | 13-25 | least distance from an obstacle on the first 2 m of these ways / 1.5 m                      |
    | 26-27 | nearest of these ways, to the right and to the left, / 90 deg, that is free for 2.5 m or up |
    |       | to the goal; 1 where none is, 0 on both sides where the goal's direction is free            |
    | 28-30 | distance / (distance + 5 m) of the goal; sine and cosine of its bearing from the heading    |
    | 31-36 | MarsNav-v0's `state`                                                                        |

    Action `Box(-1, 1, (1,), float32)`: where to drive, from 90 deg right of the goal's direction to 90 deg left of it.
    The rover turns in place while that is more than 0.5 rad off its heading, and drives at full speed on the way there
    otherwise; nought drives straight at the goal.
    """

    def __init__(self, env: gymnasium.Env) -> None:
        super().__init__(env)
        assert isinstance(env.observation_space, spaces.Dict)
        if "map" not in env.observation_space.spaces:
            raise ValueError("Corridors needs an environment made with map_observation=True")
        self.observation_space = corridor_space()
        self.action_space = spaces.Box(-1, 1, (1,), np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        observation, info = self.env.reset(seed=seed, options=options)
        return self._seen(observation), info

    def step(self, action: np.ndarray) -> tuple[np.ndarray, Any, bool, bool, dict[str, Any]]:
        env = self.unwrapped
        assert isinstance(env, MarsNavEnv) and env.action_space.shape is not None
        drive = steer(self._goal, float(action[0]), env.rover_spec)
        observation, reward, ended, cut, info = self.env.step(drive[: env.action_space.shape[0]])
        return self._seen(observation), reward, ended, cut, info

    def _seen(self, observation: dict[str, Any]) -> np.ndarray:
        env = self.unwrapped
        assert isinstance(env, MarsNavEnv)
        self._goal = observation["goal"]
        return as_corridors(observation, env.rover_spec)


def corridor_space() -> spaces.Box:
    """The space of what Corridors shows."""
    return spaces.Box(-np.inf, np.inf, (2 * WAYS + 11,), np.float32)


def as_corridors(observation: dict[str, Any], spec: RoverSpec) -> np.ndarray:
    """(37,) float32: one observation of MarsNav-v0 as Corridors shows it."""
    distance, sine, cosine = observation["goal"]
    free, room = look_along(observation["map"][1], float(np.arctan2(sine, cosine)) + _OFFSETS, spec.width / 2 + MARGIN)
    turns = np.where(free >= min(OPEN, max(distance - GOAL_RADIUS, CELL)), np.abs(_OFFSETS) / SWING, 1.0)
    nearest = [turns[: WAYS // 2 + 1].min(), turns[WAYS // 2 :].min()]
    goal = [distance / (distance + 5.0), sine, cosine]
    return np.concatenate([free / REACH, room / ROOM, nearest, goal, observation["state"]]).astype(np.float32)


def look_along(cost: np.ndarray, bearings: np.ndarray, half_width: float) -> tuple[np.ndarray, np.ndarray]:
    """What lies along straight ways from the rover.

    cost: (64, 64), MarsNav-v0's map of it, 1 at obstacles; bearings: (n,) from the heading [rad], left > 0; half_width
    [m] of the corridor. Returns (n,) how far it is free [m], at most REACH, and (n,) how near to an obstacle its first
    2 m come [m], at most ROOM.
    A rover that stands nearer to an obstacle than half_width is free to go wherever it comes no nearer.
    """
    ahead, left = np.outer(np.cos(bearings), _ALONG), np.outer(np.sin(bearings), _ALONG)
    row, column = (np.floor(PIXELS / 2 - part / CELL).astype(int) for part in (ahead, left))
    free = (cost < 1).astype(np.uint8)
    if free.all():
        return np.full(len(bearings), REACH), np.full(len(bearings), ROOM)
    clearance = cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * CELL - CELL / 2
    middle = slice(PIXELS // 2 - 1, PIXELS // 2 + 1)  # the rover stands at the corner of four cells
    near = clearance[row, column]
    hit = near < min(half_width, float(clearance[middle, middle].min()))
    length = np.where(hit.any(axis=1), hit.argmax(axis=1) * CELL, REACH)
    return length, np.clip(near[:, :_NEAR].min(axis=1), 0, ROOM)


def steer(goal: np.ndarray, turn: float, spec: RoverSpec) -> np.ndarray:
    """(3,) action of MarsNav-v0 that drives `turn` times 90 deg left of the goal's direction, as Corridors says.

    goal: (3,) as MarsNav-v0 observes it.
    """
    _, sine, cosine = goal
    bearing = float(np.arctan2(sine, cosine)) + float(np.clip(turn, -1, 1)) * SWING
    bearing = (bearing + np.pi) % (2 * np.pi) - np.pi
    yaw_rate = np.clip(bearing / (spec.max_yaw_rate * STEP_SECONDS), -1, 1)
    return np.array([abs(bearing) < TURN_IN_PLACE, yaw_rate, 0.0], dtype=np.float32)
