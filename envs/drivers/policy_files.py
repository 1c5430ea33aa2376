"""Policies of stable-baselines3 as drivers, read from their files."""

from __future__ import annotations

import io
import re
import zipfile
from pathlib import Path
from typing import IO, Any

import numpy as np
from gymnasium import spaces

from envs.drivers.corridors import AHEAD, HOLD_STEPS, WAYS, as_corridors, corridor_space, steer
from envs.drivers.image_observation import as_images, image_space
from envs.mars_nav import MarsNavEnv
from marssim.base.command.input_file import check_file

CORRIDORS = "corridors"  # name of the entry that marks a policy's .zip as one of Corridors


class PolicyDriver:
    """A PPO policy of stable-baselines3, trained through ImageObservation or Corridors.

    A policy of ImageObservation is `MultiInputPolicy` at its default sizes. A policy of Corridors
    (envs.drivers.way_policy) bears a mark in its file (mark_corridors). Of the .zip only the tensors of `policy.pth`
    are read: the pickled parts could run anything. The observed keys and the size of the action follow from the
    tensors' names and shapes; a policy that does not move the mast looks ahead.
    """

    def __init__(self, path: Path) -> None:
        """Read the policy's tensors; `reset` builds the network.

        Raises:
            FileNotFoundError: If the file is missing.
            ValueError: If the file holds no policy.
            ImportError: Raised by `reset` if stable-baselines3 is not installed.
        """
        self.path = path
        self._weights, self.corridors = _read(path)
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
            raise ImportError(f"{self.path}: needs stable-baselines3: pip install 'mars-m3depth[rl]'") from None
        policy: Any
        if self.corridors:
            policy = WayPolicy(corridor_space(), spaces.Discrete(WAYS), lambda _: 0.0)
        else:
            space = image_space(env.observation_space).spaces
            keys = {key: part for key, part in space.items() if key in self.images or len(part.shape or ()) == 1}
            actions = spaces.Box(-1, 1, (len(self._weights["log_std"]),), np.float32)
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


def mark_corridors(policy: Path | IO[bytes]) -> None:
    """Mark a policy's .zip as one that observes and acts as Corridors documents."""
    with zipfile.ZipFile(policy, "a") as archive:
        archive.writestr(CORRIDORS, "")


def _read(path: Path) -> tuple[dict[str, Any], bool]:
    """Return the tensors by name, and whether the file is marked as a policy of Corridors."""
    import torch

    check_file(path, "policy")
    try:
        with zipfile.ZipFile(path) as archive:
            weights = torch.load(io.BytesIO(archive.read("policy.pth")), map_location="cpu", weights_only=True)
            corridors = CORRIDORS in archive.namelist()
        for name in ("action_net.weight",) if corridors else ("action_net.weight", "log_std"):
            if name not in weights:
                raise ValueError(f"policy.pth has no {name}")
    except Exception as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise ValueError(f"{path}: holds no policy of stable-baselines3's PPO ({reason})") from None
    return dict(weights), corridors
