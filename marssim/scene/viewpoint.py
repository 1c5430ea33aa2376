"""Where the cameras of a stereo pair stand in a scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from marssim.base.pose import look_pose
from marssim.scene.ranges import Range, check_ranges
from marssim.scene.rocks.population import CAMERA_EXTENT
from marssim.scene.scene import Scene

ROCK_HEIGHT = 0.15  # [m] a camera keeps away from higher rocks
LEAST_HEIGHT = 0.2  # [m] of a right camera above the ground
ROCK_GAP = 0.6  # [m] least distance of a camera from them
ROVER_HEIGHT = (0.9, 1.5)  # [m] heights of the cameras at which a rover can stand below them
TRIES = 1000  # places tried before a scene counts as too rocky


@dataclass(frozen=True)
class ViewConfig:
    """Where the cameras stand. Each view draws each value from its range, LOW HIGH; give a value twice to fix it."""

    height: Range = (1.15, 1.25)
    """Height of the left camera above the ground [m], LOW HIGH, 0.2 to 10; 0.9 to 1.5 with --view.rover."""
    pitch_deg: Range = (5.0, 40.0)
    """How far the cameras look down from the horizon [deg], LOW HIGH, -90 to 90: 0 looks at the horizon, 90 straight
    down."""
    roll_deg: Range = (-15.0, 15.0)
    """Tilt of the cameras about their optical axis [deg], LOW HIGH, -180 to 180. Positive is clockwise as seen from
    behind. A drive does not use it: there, the ground alone tilts the cameras."""
    yaw_deg: Range = (0.0, 360.0)
    """Viewing direction of the cameras [deg], LOW HIGH, -360 to 360, counter-clockwise from east: 90 looks north."""
    rover: Range = (0.0, 0.0)
    """Chance with which the rover that carries the cameras is there, LOW HIGH, 0 to 1: its deck and solar panels, which
    the cameras see where the mast turns far to the side or back, and its shadow. A drive has it in all views or in
    none."""
    rover_pan_deg: Range = (-170.0, 170.0)
    """How far the mast is turned from where the rover heads [deg], LOW HIGH, -360 to 360, positive to the left, where
    the rover is there. The deck is in view beyond about 60."""

    def __post_init__(self) -> None:
        limits = {"height": (0.2, 10.0), "pitch_deg": (-90.0, 90.0), "roll_deg": (-180.0, 180.0)}
        limits |= {"yaw_deg": (-360.0, 360.0), "rover": (0.0, 1.0), "rover_pan_deg": (-360.0, 360.0)}
        check_ranges(self, limits)
        if self.rover[1] > 0 and not ROVER_HEIGHT[0] <= self.height[0] <= self.height[1] <= ROVER_HEIGHT[1]:
            low, high = ROVER_HEIGHT
            raise ValueError(
                f"height must lie within {low:g} and {high:g} m where rover is above 0, since the mast is 1.2 m high, "
                f"got {self.height[0]} {self.height[1]}"
            )


def pose_on_ground(
    scene: Scene, x: float, y: float, yaw: float, pitch: float, roll: float = 0.0, height: float = 1.2
) -> np.ndarray:
    """Return the pose of a left camera that stands above a point of the ground.

    Args:
        scene: The scene.
        x: East of the scene's middle [m].
        y: North of the scene's middle [m].
        yaw: Viewing direction [rad], counter-clockwise from east.
        pitch: How far the camera looks down from the horizon [rad].
        roll: Tilt about the optical axis [rad], clockwise as seen from behind the camera.
        height: Height of the camera above the ground [m].

    Returns:
        (4, 4) camera to world.
    """
    ground = float(scene.terrain.height_at(np.array(x), np.array(y)))
    return look_pose(np.array([x, y, ground + height]), yaw, pitch, roll)


def draw_pose(scene: Scene, view: ViewConfig, rng: np.random.Generator, baseline: float = 0.0) -> np.ndarray:
    """Draw the pose of a left camera that stands in the middle of the scene and away from rocks and ledges.

    The point below the camera keeps 0.6 m of distance to the outline discs of bodies higher than 0.15 m; see
    `is_clear_of_rocks`. A right camera, which a long baseline and a roll can put below the ground, is 0.2 m or more
    above it.

    Args:
        scene: The scene.
        view: Ranges of the camera's height and angles.
        rng: Random generator.
        baseline: How far the right camera is from the left one [m]; 0 for a left camera alone.

    Returns:
        (4, 4) camera to world.

    Raises:
        ValueError: No such place was found.
    """
    reach = CAMERA_EXTENT * scene.half
    clear = 0
    for _ in range(TRIES):
        x, y = rng.uniform(-reach, reach, 2)
        if not is_clear_of_rocks(scene, x, y):
            continue
        clear += 1
        height, yaw = rng.uniform(*view.height), np.deg2rad(rng.uniform(*view.yaw_deg))
        pitch, roll = np.deg2rad(rng.uniform(*view.pitch_deg)), np.deg2rad(rng.uniform(*view.roll_deg))
        pose = pose_on_ground(scene, x, y, yaw, pitch, roll, height)
        right = pose[:3, 3] + baseline * pose[:3, 0]
        if right[2] >= float(scene.terrain.height_at(right[0], right[1])) + LEAST_HEIGHT:
            return pose
    if clear:
        raise ValueError(
            f"scene {scene.config.preset}: in {clear} tries the right camera, {baseline:g} m beside the left one, was "
            "nowhere above the ground; choose a shorter baseline, or a smaller `view.roll_deg`"
        )
    raise ValueError(
        f"scene {scene.config.preset}: in {TRIES} tries no place {ROCK_GAP:g} m from every rock was found for the "
        "camera; choose a smaller `rocks.k`"
    )


def is_clear_of_rocks(scene: Scene, x: float, y: float) -> bool:
    """Return whether the outline disc of every body higher than ROCK_HEIGHT is at least ROCK_GAP away from a point.

    Bodies are rocks, slabs, blocks of ledges and fragments.

    The disc has the rock's area seen from above, hence its diameter D. The rock itself reaches beyond the disc: 1.3 D/2
    from its centre at the median, 1.9 D/2 at most.

    Args:
        scene: The scene.
        x: East of the scene's middle [m].
        y: North of the scene's middle [m].
    """
    tall = np.flatnonzero(scene.bodies.height > ROCK_HEIGHT)
    centre, radius = scene.bodies.centre[tall], scene.bodies.diameter[tall] / 2
    return bool((np.hypot(centre[:, 0] - x, centre[:, 1] - y) - radius >= ROCK_GAP).all())
