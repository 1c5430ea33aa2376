"""Policies of stable-baselines3 as drivers, read from their files."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces

from envs.drivers.corridors import AHEAD, HOLD_STEPS, WAYS, as_corridors, corridor_space, steer
from envs.drivers.image_observation import as_images, image_space
from envs.drivers.policy_archive import read_policy
from envs.mars_nav import MarsNavEnv

ACTION_SIZES = (2, 3)  # numbers of an action, without and with the mast


class PolicyDriver:
    """A PPO policy of stable-baselines3, trained through ImageObservation or Corridors.

    A policy of ImageObservation is `MultiInputPolicy` at its default sizes. A policy of Corridors
    (envs.drivers.way_policy) bears a mark in its file. Nothing in the file is executed (policy_archive.py). The
    observed keys and the size of the action follow from the tensors' names and shapes; a policy that does not move the
    mast looks ahead.
    """

    def __init__(self, path: Path) -> None:
        """Read the policy's tensors; `reset` builds the network.

        Raises:
            FileNotFoundError: If the file is missing.
            ValueError: If the file holds no policy.
            ImportError: Raised by `reset` if stable-baselines3 is not installed.
        """
        self.path = path
        archive = read_policy(path)
        self._weights, self.corridors = archive.weights, archive.corridors
        names = (re.match(r"features_extractor\.extractors\.(\w+)\.", name) for name in self._weights)
        self.images = sorted({name.group(1) for name in names if name})
        self.needs_map = self.corridors or "map" in self.images
        self._policy: Any = None

    def reset(self, env: MarsNavEnv, seed: int) -> None:
        self._held, self._way = 0, AHEAD  # steps for which the way is still held, and the way
        if self._policy is not None:
            return
        try:
            from stable_baselines3.common.policies import MultiInputActorCriticPolicy

            from envs.drivers.way_policy import WayPolicy
        except ImportError:
            raise ImportError(f'{self.path}: needs stable-baselines3: pip install "mars-m3depth[rl]"') from None
        policy: Any
        if self.corridors:
            policy = WayPolicy(corridor_space(), spaces.Discrete(WAYS), lambda _: 0.0)
        else:
            sizes = tuple(self._weights["log_std"].shape)
            if sizes not in [(size,) for size in ACTION_SIZES]:
                raise ValueError(f"{self.path}: an action must have 2 or 3 numbers, log_std has the shape {sizes}")
            actions = spaces.Box(-1, 1, sizes, np.float32)
            named = {*self.images, "goal", "state"} | ({"pan"} if sizes == (3,) else set())
            keys = {key: part for key, part in image_space(env.observation_space).items() if key in named}
            policy = MultiInputActorCriticPolicy(spaces.Dict(keys), actions, lambda _: 0.0)
            self._keys = list(keys)
        try:
            policy.load_state_dict(self._weights)
        except RuntimeError as error:
            raise ValueError(
                f"{self.path}: is no policy for these observations ({str(error).splitlines()[0]})"
            ) from None
        policy.set_training_mode(False)
        self._policy = policy

    def act(self, env: MarsNavEnv, observation: dict[str, Any]) -> np.ndarray:
        if self.corridors:
            if not self._held:
                self._held = HOLD_STEPS
                vector = as_corridors(observation, env.rover_spec, self._way)
                self._way = int(self._policy.predict(vector, deterministic=True)[0])
            self._held -= 1
            return steer(observation["goal"], self._way, env.rover_spec)
        images = as_images(observation)
        action, _ = self._policy.predict({key: images[key] for key in self._keys}, deterministic=True)
        padded = np.zeros(3, dtype=np.float32)
        padded[: len(action)] = action
        return padded
