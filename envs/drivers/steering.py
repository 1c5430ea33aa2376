"""The action that turns the rover towards a bearing."""

from __future__ import annotations

import numpy as np

from envs.mars_nav import STEP_SECONDS
from marssim.base.rover_spec import RoverSpec


def head_for(bearing: float, within: float, spec: RoverSpec) -> np.ndarray:
    """(3,) action of MarsNav-v0 that turns to a bearing and drives at full speed once it is ahead.

    bearing: from the heading, in [-pi, pi] [rad], left > 0; within [rad]: of straight ahead the rover drives while it
    turns, else it turns in place.
    """
    yaw_rate = np.clip(bearing / (spec.max_yaw_rate * STEP_SECONDS), -1, 1)
    return np.array([abs(bearing) < within, yaw_rate, 0.0], dtype=np.float32)
