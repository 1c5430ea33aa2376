"""Where the cameras of a stereo pair stand in a scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from marssim.base.camera import look_pose
from marssim.scene.ranges import Range, check_ranges
from marssim.scene.rocks import STAND
from marssim.scene.scene import Scene

LOW, GAP = 0.15, 0.6  # [m] a camera stands this far from rocks higher than that
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
        check_ranges(self, limits)


def draw_pose(scene: Scene, view: ViewConfig, rng: np.random.Generator) -> np.ndarray:
    """(4, 4) left camera to world: somewhere in the middle of the scene, away from rocks.

    Outline discs of rocks of more than 0.15 m height are 0.6 m and more from the point below the camera; see
    beside_rocks. Raises ValueError if no such place is found.
    """
    reach = STAND * scene.half
    for _ in range(TRIES):
        x, y = rng.uniform(-reach, reach, 2)
        if beside_rocks(scene, x, y):
            break
    else:
        raise ValueError(
            f"scene {scene.config.preset}: in {TRIES} tries no place {GAP:g} m from every rock was found for the "
            f"camera; choose a smaller `rocks.k`"
        )
    position = np.array([x, y, float(scene.terrain.height_at(x, y)) + rng.uniform(*view.height)])
    yaw = np.deg2rad(rng.uniform(*view.yaw_deg))
    pitch, roll = np.deg2rad(rng.uniform(*view.pitch_deg)), np.deg2rad(rng.uniform(*view.roll_deg))
    return look_pose(position, yaw, pitch, roll)


def beside_rocks(scene: Scene, x: float, y: float) -> bool:
    """No outline disc of a rock of more than LOW is nearer than GAP to this point. x, y: [m].

    The disc is that of the rock's area seen from above, its diameter D. The rock itself reaches beyond it: 1.3 D / 2 at
    the median, 1.9 D / 2 at most.
    """
    tall = np.flatnonzero(scene.rocks.height > LOW)
    centre, radius = scene.rocks.centre[tall], scene.rocks.diameter[tall] / 2
    return bool((np.hypot(centre[:, 0] - x, centre[:, 1] - y) - radius >= GAP).all())
