"""The action that turns the rover towards a bearing."""

from __future__ import annotations

import numpy as np

from envs.mars_nav import STEP_SECONDS
from marssim.base.rover_spec import RoverSpec


def head_for(bearing: float, within: float, spec: RoverSpec) -> np.ndarray:
    """Return the action of MarsNav-v0 that turns to a bearing and drives at full speed once it is ahead.

    Args:
        bearing: From the heading, in [-pi, pi] [rad], positive to the left.
        within: Bearing below which the rover drives while it turns [rad]; beyond it the rover turns in place.
        spec: The rover.

    Returns:
        (3,) action.
    """
    yaw_rate = np.clip(bearing / (spec.max_yaw_rate * STEP_SECONDS), -1, 1)
    return np.array([abs(bearing) < within, yaw_rate, 0.0], dtype=np.float32)
