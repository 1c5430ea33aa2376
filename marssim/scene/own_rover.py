"""Where the rover that carries the cameras stands below them."""

from __future__ import annotations

import numpy as np

from marssim.base.rover_spec import ZHURONG, RoverSpec
from marssim.scene.scene import Scene
from marssim.scene.trajectory import MastState, obstacle_discs, stand_on
from marssim.scene.viewpoint import TRIES, ViewConfig, draw_pose

ROVER_DRAWS = 0x726F766572  # separates the draws of the rover from all others of a seed: of a view and of its scene


def draw_pan(view: ViewConfig, rng: np.random.Generator) -> float | None:
    """Draw whether the rover is there, and the pan of its mast.

    Args:
        view: Ranges of the chance and of the pan.
        rng: Random generator of these two draws alone.

    Returns:
        The pan [rad], positive to the left; None for a view without the rover.
    """
    present = rng.random() < rng.uniform(*view.rover)
    pan = float(np.deg2rad(rng.uniform(*view.rover_pan_deg)))
    return pan if present else None


def draw_pose_of_rover(
    scene: Scene, view: ViewConfig, rng: np.random.Generator, mast: MastState, rover: RoverSpec = ZHURONG
) -> np.ndarray:
    """Draw the pose of a left camera, as draw_pose does, whose rover stands free of what it cannot drive over.

    Args:
        scene: The scene.
        view: Ranges of the camera's height and angles.
        rng: Random generator.
        mast: Where the rover has the camera.
        rover: The rover.

    Returns:
        (4, 4) camera to world.

    Raises:
        ValueError: No such place was found.
    """
    obstacles = obstacle_discs(scene)
    for _ in range(TRIES):
        pose = draw_pose(scene, view, rng, mast.baseline)
        if _stands_free(obstacles, rover_below(scene, pose, mast.baseline, mast.pan, rover), rover):
            return pose
    raise ValueError(
        f"scene {scene.config.preset}: in {TRIES} tries no place was found where the rover touches no rock; choose a "
        "smaller `rocks.k`"
    )


def _stands_free(obstacles: np.ndarray, body: np.ndarray, rover: RoverSpec) -> bool:
    """Return whether no disc (M, 3) x, y, radius [m] reaches into the footprint of a rover at a pose (4, 4)."""
    offset = obstacles[:, :2] - body[:2, 3]
    forward = body[:2, 0] / np.hypot(*body[:2, 0])
    ahead, left = offset @ forward, offset @ np.array([-forward[1], forward[0]])
    outside = np.maximum(np.abs(ahead) - rover.length / 2, 0), np.maximum(np.abs(left) - rover.width / 2, 0)
    return bool((np.hypot(*outside) > obstacles[:, 2]).all())


def rover_below(
    scene: Scene, pose: np.ndarray, baseline: float, pan: float, rover: RoverSpec = ZHURONG
) -> np.ndarray:  # fmt: skip
    """Return the pose of the rover whose left camera has a given pose.

    The rover leans as the ground under its wheels does. Its height follows from that of the camera.

    Args:
        scene: The scene.
        pose: (4, 4) left camera to world.
        baseline: Distance between the cameras [m].
        pan: Pan of the mast [rad], positive to the left: the rover heads this much to the right of the viewing
            direction.
        rover: The rover.

    Returns:
        (4, 4) body (x forward, y left, z up) to world.
    """
    ahead = pose[:2, 2]
    if abs(pose[2, 2]) > 0.99:  # the camera looks down or up: the upper or lower side of its image is ahead
        ahead = np.sign(pose[2, 2]) * pose[:2, 1]
    eye = rover.mount.left_eye(baseline, pan)[:3, 3]
    heading = float(np.arctan2(ahead[1], ahead[0])) - pan
    c, s = np.cos(heading), np.sin(heading)
    x, y = pose[:2, 3] - np.array([[c, -s], [s, c]]) @ eye[:2]
    body = stand_on(scene, float(x), float(y), heading, rover)
    body[:3, 3] = pose[:3, 3] - body[:3, :3] @ eye
    return body
