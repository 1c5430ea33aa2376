"""MarsNav-v0 as images, for policies that are convolutional networks (envs.drivers.corridors: small networks)."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from envs.observation.spaces import check_observations, share_of_distance
from marssim.base.camera import MAX_DEPTH, MIN_DEPTH


class ImageObservation(gymnasium.ObservationWrapper, gymnasium.utils.RecordConstructorArgs):
    """MarsNav-v0 with depth and map as uint8 images, as `MultiInputPolicy` of stable-baselines3 expects them.

    Images have their channels first; the goal's distance lies in [0, 1].

    | Key     | Shape       | Meaning                                                        |
    |---------|-------------|----------------------------------------------------------------|
    | `depth` | (1, 64, 64) | nearness: 255 at 0.5 m, 0 from 15 m on and where unknown       |
    | `map`   | (3, 64, 64) | the map's channels: height (128 is the rover's), cost, known   |
    | `goal`  | (3,)        | distance / (distance + 5 m); sine and cosine of the bearing    |
    | `state` | (6,)        | as in MarsNav-v0                                               |
    | `pan`   | (1,)        | as in MarsNav-v0                                               |
    """

    def __init__(self, env: gymnasium.Env) -> None:
        gymnasium.utils.RecordConstructorArgs.__init__(self)
        gymnasium.ObservationWrapper.__init__(self, env)
        check_observations(env, "ImageObservation", with_map=False)
        self.observation_space = image_space(env.observation_space)

    def observation(self, observation: dict[str, Any]) -> dict[str, Any]:
        """Return one observation of MarsNav-v0 as the class documents it."""
        return as_images(observation)


def image_space(inner: gymnasium.Space) -> spaces.Dict:
    """Return the observation space of ImageObservation over that of MarsNav-v0."""
    assert isinstance(inner, spaces.Dict)
    out: dict[str, spaces.Space] = dict(inner.spaces)
    shape = inner["depth"].shape
    assert shape is not None
    out["depth"] = spaces.Box(0, 255, (1, *shape), np.uint8)
    if "map" in out:
        out["map"] = spaces.Box(0, 255, inner["map"].shape, np.uint8)
    out["goal"] = spaces.Box(np.array([0, -1, -1], np.float32), np.ones(3, np.float32), dtype=np.float32)
    return spaces.Dict(out)


def as_images(observation: dict[str, Any]) -> dict[str, Any]:
    """Return one observation of MarsNav-v0 as ImageObservation shows it."""
    depth, goal = observation["depth"], np.array(observation["goal"], dtype=np.float32)
    near = np.where(depth > 0, 1 / np.maximum(depth, MIN_DEPTH) - 1 / MAX_DEPTH, 0) / (1 / MIN_DEPTH - 1 / MAX_DEPTH)
    goal[0] = share_of_distance(goal[0])
    out = {**observation, "depth": np.round(255 * near).astype(np.uint8)[None], "goal": goal}
    if "map" in observation:
        height, cost, valid = observation["map"]
        out["map"] = np.round(255 * np.stack([(height + 1) / 2, cost, valid])).astype(np.uint8)
    return out
