"""A drive over a scene: the poses of a rover's left camera, step by step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from marssim.base.pose import look_pose
from marssim.base.rover_spec import ZHURONG, RoverSpec
from marssim.scene.rocks.outlines import reach_above_ground
from marssim.scene.rocks.population import CAMERA_EXTENT
from marssim.scene.scene import Scene
from marssim.scene.steep_ground import steep_ground
from marssim.scene.viewpoint import TRIES, ViewConfig

TRAJECTORY = "trajectory.txt"  # file beside the views of a scene that are a drive; see tum_lines
MAX_CURVATURE = 0.5  # [1/m] of the path
MAX_CHANGE = 0.8  # [1/m2] change of the curvature along the path, which keeps the heading smooth
CHOICES = np.linspace(-MAX_CURVATURE, MAX_CURVATURE, 11)  # [1/m] curvatures to choose from
AHEAD = 5.0  # [m] distance to look ahead, enough to turn away from any obstacle
STEEP_CELL = 0.2  # [m] grid on which steep ground is looked for
TESTED = 0.05  # [m] about the distance of the places ahead that are tested, where strides are shorter
LONGEST_STRIDE = 0.2  # [m] largest distance between two choices of the curvature


@dataclass(frozen=True)
class MastState:
    """The mast of a rover that is in view.

    Attributes:
        baseline: Distance between its cameras [m].
        pan: How far it is turned from where the rover heads [rad], positive to the left.
    """

    baseline: float
    pan: float


@dataclass(frozen=True)
class TrajectoryConfig:
    """How a drive is sampled."""

    step: float = 0.4
    """Distance between two stereo pairs of a drive [m], 0.001 to 5. It needs --trajectory."""
    speed: float = 0.056
    """Speed of the rover [m/s], 0.0001 to 10, which determines the time stamps of a drive. It needs --trajectory."""

    def __post_init__(self) -> None:
        if not 0.001 <= self.step <= 5:
            raise ValueError(f"step must lie in [0.001, 5] m, got {self.step}")
        if not 0.0001 <= self.speed <= 10:
            raise ValueError(f"speed must lie in [0.0001, 10] m/s, got {self.speed:g}")


def draw_trajectory(
    scene: Scene, view: ViewConfig, config: TrajectoryConfig, count: int, rng: np.random.Generator,
    mast: MastState | None = None,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Draw the camera's poses along a smooth path past the rocks, in the middle of the scene.

    From pose to pose, the rover's middle moves `config.step` along the path, measured on the map. It keeps half the
    rover's width from all that obstacle rocks show above ground, and from steep ground. The rover stands on the plane
    that fits the ground under its wheels. The camera's height and pitch are drawn once and hold relative to that plane,
    so the ground's slope adds to pitch and roll in the world. view.roll_deg is not used. Without a mast, the camera is
    above the rover's middle and looks ahead.

    Args:
        scene: The scene.
        view: Ranges of the camera's height, pitch and of the first heading.
        config: Distance between two poses.
        count: Number of poses.
        rng: Random generator.
        mast: Where the rover has the camera, if it is in view; its pan is held over the drive.

    Returns:
        (count, 4, 4) left camera to world, and (4, 4) left camera to rover, which stays over the drive.

    Raises:
        ValueError: No such path was found.
    """
    height, pitch = rng.uniform(*view.height), np.deg2rad(rng.uniform(*view.pitch_deg))
    strides = int(np.ceil(config.step / LONGEST_STRIDE))
    obstacles = obstacle_discs(scene)
    eye, beside = look_pose(np.array([0, 0, height]), 0.0, pitch), 0.0
    if mast is not None:
        x, y = ZHURONG.mount.left_eye(mast.baseline, mast.pan)[:2, 3]
        eye, beside = look_pose(np.array([x, y, height]), mast.pan, pitch), float(np.hypot(x, y))
    if (reach := CAMERA_EXTENT * scene.half - beside) <= 0:
        raise ValueError(
            f"scene {scene.config.preset}: its square is too small for a drive whose left eye is {beside:.2f} m beside "
            "the rover's middle; choose a larger `size` or a shorter `rig.baseline`"
        )
    for _ in range(TRIES):
        path = _draw_path(scene, obstacles, view, (count - 1) * strides, config.step / strides, rng, reach)
        if path is not None:
            bodies = [stand_on(scene, *state) for state in path[::strides]]
            return np.stack([body @ eye for body in bodies]), eye
    raise ValueError(
        f"scene {scene.config.preset}: in {TRIES} tries no path of {(count - 1) * config.step:g} m past the rocks and "
        f"steep ground was found; choose a smaller `rocks.k`, `views_per_scene` or `drive.step`"
    )


def stand_on(scene: Scene, x: float, y: float, yaw: float, rover: RoverSpec = ZHURONG) -> np.ndarray:
    """Return the pose of a rover on the plane that best fits the ground under its wheels.

    Args:
        scene: The scene.
        x: East coordinate of the rover's middle [m].
        y: North coordinate [m].
        yaw: Heading [rad], counter-clockwise from east.
        rover: Positions of the wheels.

    Returns:
        (4, 4) body (x forward, y left, z up) to world.
    """
    wheels = np.array([(wx, wy) for wx in rover.wheel_x for wy in (-rover.track / 2, rover.track / 2)])
    c, s = np.cos(yaw), np.sin(yaw)
    at = wheels @ np.array([[c, s], [-s, c]]) + [x, y]
    ground = scene.terrain.height_at(at[:, 0], at[:, 1])
    (a, b, z), *_ = np.linalg.lstsq(np.column_stack([at - [x, y], np.ones(len(at))]), ground, rcond=None)
    up = np.array([-a, -b, 1.0])
    up /= np.linalg.norm(up)
    forward = np.array([c, s, a * c + b * s])
    forward /= np.linalg.norm(forward)
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([forward, np.cross(up, forward), up])
    pose[:3, 3] = x, y, z
    return pose


def tum_lines(times: Sequence[float], poses: np.ndarray) -> str:
    """Return poses in the format of the TUM RGB-D benchmark: timestamp tx ty tz qx qy qz qw, one pose a line.

    Args:
        times: N time stamps [s].
        poses: (N, 4, 4) camera to world.
    """
    lines = ["# left camera (x right, y down, z forward) to world (z up); timestamp [s] tx ty tz [m] qx qy qz qw"]
    for time, pose in zip(times, np.asarray(poses, dtype=float)):
        numbers = (*pose[:3, 3], *scipy.spatial.transform.Rotation.from_matrix(pose[:3, :3]).as_quat(canonical=True))
        lines.append(f"{time:.6f} " + " ".join(f"{number:.9f}" for number in numbers))
    return "\n".join(lines) + "\n"


def _draw_path(
    scene: Scene, obstacles: np.ndarray, view: ViewConfig, strides: int, stride: float, rng: np.random.Generator,
    reach: float,
) -> list | None:  # fmt: skip
    """Draw strides + 1 states (x, y, yaw), `stride` [m] apart; return None where the path ends at an obstacle.

    The path stays within `reach` [m] of the middle of the scene, along both axes.

    Each stride takes the curvature that stays free for longest. Among equals, it takes the one nearest to a random
    curvature that varies smoothly over a few metres.
    """
    x, y = rng.uniform(-reach, reach, 2)
    yaw = np.deg2rad(rng.uniform(*view.yaw_deg))
    waves = rng.uniform(0.2, 1.0, 3), rng.uniform(0, 2 * np.pi, 3)  # [rad/m], [rad]
    if not _free(obstacles, x, y):
        return None
    turn, path = 0.0, [(x, y, yaw)]
    ahead = max(1, int(np.ceil(AHEAD / stride)))
    every = max(1, int(TESTED / stride))  # of the places ahead that are tested
    for n in range(strides):
        preferred = MAX_CURVATURE * np.sin(waves[0] * n * stride + waves[1]).mean()
        px, py = np.full(len(CHOICES), x), np.full(len(CHOICES), y)
        heading, curvature = np.full(len(CHOICES), yaw), np.full(len(CHOICES), turn)
        points = []
        for place in range(ahead):
            change = MAX_CHANGE * stride
            curvature = curvature + np.clip(CHOICES - curvature, -change, change)
            heading = heading + curvature * stride
            px, py = px + stride * np.cos(heading), py + stride * np.sin(heading)
            if place % every == 0:
                points.append((px, py))
            if place == 0:
                first = heading, curvature
        xs, ys = (np.array(axis) for axis in zip(*points))
        free = _free(obstacles, xs, ys) & (np.maximum(np.abs(xs), np.abs(ys)) <= reach)
        length = np.where(free.all(axis=0), len(points), free.argmin(axis=0))
        if length.max() == 0:
            return None
        best = int(np.argmin(np.where(length == length.max(), np.abs(CHOICES - preferred), np.inf)))
        x, y, yaw, turn = float(xs[0, best]), float(ys[0, best]), float(first[0][best]), float(first[1][best])
        path.append((x, y, yaw))
    return path


def obstacle_discs(scene: Scene) -> np.ndarray:
    """Return (M, 3) x, y and radius [m] of discs on the bodies and the ground that the rover cannot drive over."""
    tall = np.flatnonzero(scene.bodies.height >= ZHURONG.obstacle_height)
    reach = reach_above_ground(scene.bodies, tall, scene.terrain.height_at)
    rocks = np.column_stack([scene.bodies.centre[tall, :2], reach])
    row, column = np.nonzero(steep_ground(scene.terrain, ZHURONG, scene.half, STEEP_CELL))
    steep = np.column_stack([column * STEEP_CELL - scene.half, row * STEEP_CELL - scene.half, 0 * row])
    return np.concatenate([rocks, steep])


def _free(obstacles: np.ndarray, x: np.ndarray | float, y: np.ndarray | float) -> np.ndarray:
    """Return (...) bool: points at least half the rover's width away from all obstacles (M, 3)."""
    cx, cy, radius = obstacles.T
    away = np.hypot(cx - np.asarray(x)[..., None], cy - np.asarray(y)[..., None]) - radius
    return (away >= ZHURONG.width / 2).all(axis=-1)
