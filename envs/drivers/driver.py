"""What a driver is: the interface that every driver of MarsNav-v0 has."""

from __future__ import annotations

from enum import Enum
from typing import Any, Protocol

import numpy as np

from envs.mars_nav import MarsNavEnv


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
