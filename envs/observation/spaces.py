"""What the rover tells its driver: the spaces of MarsNav-v0's observation, and how it is made up."""

from __future__ import annotations

import numpy as np
from gymnasium import spaces

from envs.observation.map_view import PIXELS
from envs.observation.nearest_depth import nearest_depth
from marssim.base.camera import MAX_DEPTH
from marssim.physics.state import RoverState

DEPTH_PIXELS = 64  # a side of the observed depth
HALFWAY = 5.0  # [m] from the goal, which share_of_distance makes one half


def observation_space(with_map: bool) -> spaces.Dict:
    """The Dict that MarsNavEnv documents. with_map: whether "map" is in it."""
    space = spaces.Dict(
        {
            "depth": spaces.Box(0, MAX_DEPTH, (DEPTH_PIXELS, DEPTH_PIXELS), np.float32),
            "goal": spaces.Box(
                np.array([0, -1, -1], np.float32), np.array([np.inf, 1, 1], np.float32), dtype=np.float32
            ),
            "state": spaces.Box(-np.inf, np.inf, (6,), np.float32),
        }
    )
    if with_map:
        low = np.broadcast_to(np.array([-1, 0, 0], np.float32)[:, None, None], (3, PIXELS, PIXELS))
        space["map"] = spaces.Box(low, np.ones(low.shape, np.float32), dtype=np.float32)
    return space


def observe(
    depth: np.ndarray, pose: np.ndarray, goal: np.ndarray, state: RoverState, last_action: np.ndarray
) -> dict[str, np.ndarray]:
    """The observation without its map.

    depth: (H, W) [m] of the look; pose: (4, 4) body to world, as the rover believes; goal: (2,) world [m]; state: how
    it stands and moves; last_action: (2,).
    """
    offset = goal - pose[:2, 3]
    bearing = np.arctan2(offset[1], offset[0]) - np.arctan2(pose[1, 0], pose[0, 0])
    motion = [state.roll, state.pitch, state.velocity[0], state.yaw_rate, *last_action]
    return {
        "depth": nearest_depth(depth, DEPTH_PIXELS),
        "goal": np.array([np.hypot(*offset), np.sin(bearing), np.cos(bearing)], dtype=np.float32),
        "state": np.array(motion, dtype=np.float32),
    }


def share_of_distance(distance: float) -> float:
    """The goal's distance [m] within [0, 1), for networks: finest near the goal."""
    return distance / (distance + HALFWAY)
