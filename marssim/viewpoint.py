"""Where the cameras of a stereo pair stand in a scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from marssim.camera import look_pose
from marssim.scene.scene import Scene

Range = tuple[float, float]
TRIES = 1000  # places looked at before a scene is called too rocky


@dataclass(frozen=True)
class ViewConfig:
    """Where the cameras stand. Each view draws from these ranges, LOW HIGH; give a value twice to fix it."""

    height: Range = (1.15, 1.25)
    """height of the left eye above the ground [m]"""
    pitch_deg: Range = (5.0, 40.0)
    """how far the cameras look down from the horizon [deg]"""
    roll_deg: Range = (-8.0, 8.0)
    """tilt of the cameras about their optical axis [deg], positive is clockwise as seen from behind"""

    def __post_init__(self) -> None:
        limits = {"height": (0.2, 10.0), "pitch_deg": (-90.0, 90.0), "roll_deg": (-180.0, 180.0)}
        for name, (low, high) in vars(self).items():
            least, most = limits[name]
            if not least <= low <= high <= most:
                flag = "--view." + name.replace("_", "-")
                raise ValueError(f"{flag} must be a range LOW HIGH within {least:g} and {most:g}, got {low} {high}")


def draw_pose(scene: Scene, view: ViewConfig, rng: np.random.Generator) -> np.ndarray:
    """(4, 4) left camera to world: somewhere in the middle of the scene, away from rocks.

    No rock of more than 0.15 m height is nearer than 0.6 m to the point below the camera. Raises ValueError if no such
    place is found.
    """
    rocks = scene.rocks
    reach = 0.4 * scene.half
    for _ in range(TRIES):
        x, y = rng.uniform(-reach, reach, 2)
        gap = np.hypot(rocks.centre[:, 0] - x, rocks.centre[:, 1] - y) - rocks.diameter / 2
        if not ((gap < 0.6) & (rocks.height > 0.15)).any():
            break
    else:
        raise ValueError(
            f"scene {scene.config.preset}: in {TRIES} tries no place 0.6 m from every rock was found for the camera; "
            f"choose a smaller --k"
        )
    position = np.array([x, y, float(scene.terrain.height_at(x, y)) + rng.uniform(*view.height)])
    yaw = rng.uniform(0, 2 * np.pi)
    pitch, roll = np.deg2rad(rng.uniform(*view.pitch_deg)), np.deg2rad(rng.uniform(*view.roll_deg))
    return look_pose(position, yaw, pitch, roll)
