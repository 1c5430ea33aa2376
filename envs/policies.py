"""Policies from elsewhere as drivers: stable-baselines3's files, and classes by their path."""

from __future__ import annotations

import importlib
import io
import re
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces

from envs.drivers import straight_action
from envs.mars_nav import MarsNavEnv
from envs.wrappers import as_images, image_space

RESIDUAL = "added_to_straight"  # an entry in a policy's .zip


class PolicyDriver:
    """A PPO policy of stable-baselines3 (`MultiInputPolicy`, its default sizes), trained through ImageObservation, and
    through StraightResidual where mark_residual says so in the file.

    Of the .zip only the tensors of `policy.pth` are read: what is pickled beside them could run anything. Observed keys
    and size of the action follow from the tensors' names and shapes; a policy that does not move the mast looks ahead.
    """

    def __init__(self, path: Path) -> None:
        """Raises FileNotFoundError or ValueError that names the file; reset raises ImportError without the package."""
        self.path = path
        self._weights, self.residual = _read(path)
        names = (re.match(r"features_extractor\.extractors\.(\w+)\.", name) for name in self._weights)
        self.images = sorted({name.group(1) for name in names if name})
        self.needs_map = "map" in self.images
        self._policy: Any = None

    def reset(self, env: MarsNavEnv, seed: int) -> None:
        if self._policy is not None:
            return
        try:
            from stable_baselines3.common.policies import MultiInputActorCriticPolicy
        except ImportError:
            raise ImportError(f"{self.path}: needs stable-baselines3: pip install 'mars-m3depth[rl]'") from None
        space = image_space(env.observation_space)
        keys = {key: part for key, part in space.spaces.items() if key in self.images or len(part.shape or ()) == 1}
        actions = len(self._weights["log_std"])
        policy = MultiInputActorCriticPolicy(
            spaces.Dict(keys), spaces.Box(-1, 1, (actions,), np.float32), lambda _: 0.0
        )
        try:
            policy.load_state_dict(self._weights)
        except RuntimeError as error:
            raise ValueError(
                f"{self.path}: is no policy for these observations ({str(error).splitlines()[0]})"
            ) from None
        policy.set_training_mode(False)
        self._policy, self._keys = policy, list(keys)

    def act(self, env: MarsNavEnv, observation: dict[str, Any]) -> np.ndarray:
        seen = as_images(observation)
        action, _ = self._policy.predict({key: seen[key] for key in self._keys}, deterministic=True)
        padded = np.zeros(3, dtype=np.float32)
        padded[: len(action)] = action
        if self.residual:
            padded += straight_action(observation["goal"], env.rover_spec)
        return np.clip(padded, -1, 1)


def mark_residual(path: Path) -> None:
    """Note in a policy's .zip that its actions are added to those of `straight`."""
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr(RESIDUAL, "")


def _read(path: Path) -> tuple[dict[str, Any], bool]:
    """The tensors by name, and whether the actions are added to `straight`'s."""
    import torch

    if not path.is_file():
        raise FileNotFoundError(f"{path}: there is no such policy")
    try:
        with zipfile.ZipFile(path) as archive:
            weights = torch.load(io.BytesIO(archive.read("policy.pth")), map_location="cpu", weights_only=True)
            residual = RESIDUAL in archive.namelist()
        if "log_std" not in weights:
            raise ValueError("policy.pth has no log_std")
    except Exception as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise ValueError(f"{path}: holds no policy of stable-baselines3's PPO ({reason})") from None
    return dict(weights), residual


def load_driver_class(name: str) -> Any:
    """A driver from "package.module:Class", made without arguments. Raises ValueError that names what is wrong."""
    module, _, attribute = name.partition(":")
    try:
        made = getattr(importlib.import_module(module), attribute)()
    except (ImportError, AttributeError, TypeError, ValueError) as error:
        raise ValueError(f"driver {name!r} cannot be made: {error}") from None
    if not (callable(getattr(made, "act", None)) and callable(getattr(made, "reset", None))):
        raise ValueError(f"driver {name!r} has no methods reset and act")
    return made
