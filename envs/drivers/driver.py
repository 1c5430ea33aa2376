"""The interface of every driver of MarsNav-v0."""

from __future__ import annotations

from enum import Enum
from typing import Any, Protocol

import numpy as np

from envs.mars_nav import MarsNavEnv


class Stop(Enum):
    """The reason for which a driver ends its drive. The values are the outcomes that envs.drives.episodes records."""

    NO_PATH = "no_path"
    """The driver finds no way to the goal."""
    ARRIVED = "elsewhere"
    """The driver believes that it is at the goal. If it were, the environment would have ended the drive before."""


class Driver(Protocol):
    """Chooses the actions of a MarsNavEnv that was made with mast=True.

    A driver whose attribute `needs_map` is true gets an environment with map_observation=True.
    """

    def reset(self, env: MarsNavEnv, seed: int) -> None:
        """Begin a new episode.

        Args:
            env: The environment, on its new course.
            seed: Seed of the course.
        """

    def act(self, env: MarsNavEnv, observation: dict[str, Any]) -> np.ndarray | Stop:
        """Return the next action, or a Stop that ends the drive.

        Args:
            env: The environment.
            observation: Its last observation.

        Returns:
            (3,) in [-1, 1]: speed, yaw rate, pan of the mast.
        """
        ...
