"""Where the cameras of a stereo pair stand in a scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from marssim.camera import look_pose
from marssim.scene.rocks import STAND
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
    roll_deg: Range = (-15.0, 15.0)
    """tilt of the cameras about their optical axis [deg], positive is clockwise as seen from behind"""
    yaw_deg: Range = (0.0, 360.0)
    """direction they look in [deg], counter-clockwise from east"""

    def __post_init__(self) -> None:
        limits = {"height": (0.2, 10.0), "pitch_deg": (-90.0, 90.0), "roll_deg": (-180.0, 180.0)}
        limits["yaw_deg"] = (-360.0, 360.0)
        for name, (low, high) in vars(self).items():
            least, most = limits[name]
            if not least <= low <= high <= most:
                raise ValueError(f"{name} must be a range LOW HIGH within {least:g} and {most:g}, got {low} {high}")


def draw_pose(scene: Scene, view: ViewConfig, rng: np.random.Generator) -> np.ndarray:
    """(4, 4) left camera to world: somewhere in the middle of the scene, away from rocks.

    No rock of more than 0.15 m height is nearer than 0.6 m to the point below the camera. Raises ValueError if no such
    place is found.
    """
    reach = STAND * scene.half
    for _ in range(TRIES):
        x, y = rng.uniform(-reach, reach, 2)
        if beside_rocks(scene, x, y):
            break
    else:
        raise ValueError(
            f"scene {scene.config.preset}: in {TRIES} tries no place 0.6 m from every rock was found for the camera; "
            f"choose a smaller --rocks.k"
        )
    position = np.array([x, y, float(scene.terrain.height_at(x, y)) + rng.uniform(*view.height)])
    yaw = np.deg2rad(rng.uniform(*view.yaw_deg))
    pitch, roll = np.deg2rad(rng.uniform(*view.pitch_deg)), np.deg2rad(rng.uniform(*view.roll_deg))
    return look_pose(position, yaw, pitch, roll)


def beside_rocks(
    scene: Scene, x: np.ndarray | float, y: np.ndarray | float, height: float = 0.15, gap: float = 0.6
) -> np.ndarray:
    """(...) bool: no rock of more than that height is nearer than `gap` to these points. x, y: (...), all in [m]."""
    tall = np.flatnonzero(scene.rocks.height > height)
    centre, radius = scene.rocks.centre[tall], scene.rocks.diameter[tall] / 2
    away = np.hypot(centre[:, 0] - np.asarray(x)[..., None], centre[:, 1] - np.asarray(y)[..., None]) - radius
    return (away >= gap).all(axis=-1)
