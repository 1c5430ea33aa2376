"""The spaces of MarsNav-v0's observation, and the observation without its map."""

from __future__ import annotations

import gymnasium
import numpy as np
from gymnasium import spaces

from envs.observation.map_view import PIXELS
from envs.observation.nearest_depth import nearest_depth
from envs.world.eyes import DEPTH_PIXELS
from marssim.base.camera import MAX_DEPTH
from marssim.base.pose import planar_pose
from marssim.physics.state import RoverState

SHOWN = 80  # characters of a space in a message
HALFWAY = 5.0  # [m] from the goal at which share_of_distance is one half


def observation_space(with_map: bool, with_pan: bool) -> spaces.Dict:
    """Return the Dict space that MarsNavEnv documents; with_map, with_pan: whether it has "map" and "pan"."""
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
    if with_pan:
        space["pan"] = spaces.Box(-1, 1, (1,), np.float32)
    return space


def check_observations(env: gymnasium.Env, wrapper: str, with_map: bool) -> None:
    """Raise ValueError if a wrapper of MarsNav-v0 is put round something else, or round another one's observations.

    Args:
        env: What is wrapped.
        wrapper: Its name, for the message.
        with_map: Whether it needs the map.
    """
    maps = (True,) if with_map else (False, True)
    choices = [observation_space(has_map, has_pan) for has_map in maps for has_pan in (False, True)]
    if env.observation_space not in choices:
        needed = " made with map_observation=True" if with_map else ""
        raise ValueError(
            f"{wrapper} needs the observations of MarsNav-v0{needed}, got {str(env.observation_space)[:SHOWN]}"
        )


def observe(
    depth: np.ndarray,
    pose: np.ndarray,
    goal: np.ndarray,
    state: RoverState,
    excess: float,
    last_action: np.ndarray,
    pan: float | None,
) -> dict[str, np.ndarray]:
    """Return the observation without its map.

    Args:
        depth: (H, W) depth of the look [m].
        pose: (4, 4) believed pose, body to world.
        goal: (2,) goal in the world [m].
        state: Attitude and motion of the rover.
        excess: Speed that the odometry measures beyond the rover's own, as its wheels slip [m/s].
        last_action: (2,) the last action.
        pan: Pan of the mast as a share of the largest; None for a mast that is not moved.
    """
    offset = goal - pose[:2, 3]
    bearing = np.arctan2(offset[1], offset[0]) - planar_pose(pose)[2]
    motion = [state.roll, state.pitch, state.velocity[0] + excess, state.yaw_rate, *last_action]
    observation = {
        "depth": nearest_depth(depth, DEPTH_PIXELS),
        "goal": np.array([np.hypot(*offset), np.sin(bearing), np.cos(bearing)], dtype=np.float32),
        "state": np.array(motion, dtype=np.float32),
    }
    return observation if pan is None else observation | {"pan": np.array([pan], dtype=np.float32)}


def share_of_distance(distance: float) -> float:
    """Return the goal's distance [m] scaled to [0, 1), for networks: finest near the goal."""
    return distance / (distance + HALFWAY)
