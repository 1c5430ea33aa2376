"""A film of a drive: the rover from outside, its left eye, its depth and normals, and its map."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import TracebackType

import cv2
import numpy as np

from envs.drivers.builtin import NavigatorDriver
from envs.drivers.driver import Driver
from envs.mars_nav import MarsNavEnv
from envs.world.outside_view import HEIGHT, OutsideView
from envs.world.referee import DRIVING, GOAL_ASTRAY
from marssim.base.images.colours import DEPTH_TITLE, NORMAL_TITLE, TICKS, depth_bar, depth_colours, normal_colours
from marssim.base.images.video_file import written_video
from marssim.base.pose import planar_pose
from marssim.base.rover_spec import RoverSpec
from marssim.physics.state import RoverState
from nav.ground.map_files import UNKNOWN_COLOUR, class_colours
from nav.navigator import Navigator
from nav.path.footprint import footprint_corners

PANEL = HEIGHT  # [px] side of the square panels: as high as the outside view, and half as wide
MAP_METRES = 24.0  # [m] side of the map
SCALE_BAR = 5.0  # [m] length of the map's scale
MAP_TITLE = "map: yellow costly, orange too near, red blocked"
GOAL_COLOUR = (80, 200, 255)
TEXT = cv2.FONT_HERSHEY_SIMPLEX, 0.45, (240, 240, 240), 1, cv2.LINE_AA  # font, size, colour, weight
FPS = 5  # frames a second
LAST_FRAMES = 2 * FPS  # frames that show how a drive ended
STILL_EVERY = 10  # steps between two stills


@dataclass(frozen=True)
class _Step:
    """What a frame shows before the driver has decided."""

    step: int
    """Number of the step."""
    ground: Callable[[], np.ndarray]
    """Draws the map as the driver knows it when it is called."""
    panels: list[np.ndarray]
    """The view from outside and the titled pictures of the last look: left eye, depth, normals."""
    lines: list[str]
    """What stands on the view from outside, but for the command: title, motion, contact, ending."""
    frames: int
    """How many frames show it."""


class Film:
    """Writes a frame for each step into an mp4 file (MPEG-4, 5 frames a second), and shows for 2 s how the drive ended.

    A frame shows a step as the driver met it: where the rover stands, its last look, the map that the driver made of
    it, and the motion that it chose. So a step is written when the next one is watched, and a last step without a next
    one when the film is closed.

    Give `watch` to envs.drives.episodes.run_episode. Use the film as a context manager, or close() it. The file gets
    its name when the film is whole: an exception in the block leaves an older file, or none.

    Attributes:
        title: What is driven; it stands on every frame.
        stills: Every tenth frame, (H, W, 3) uint8.
    """

    def __init__(self, path: str | os.PathLike[str], title: str = "") -> None:
        """Open the file.

        Args:
            path: The file.
            title: What is driven; it stands on every frame.

        Raises:
            OSError: If the file cannot be written.
        """
        self._file = ExitStack()
        self._write = self._file.enter_context(written_video(Path(path), (3 * PANEL, 2 * PANEL), FPS))
        self.title = title
        self.stills: list[np.ndarray] = []
        self._view: OutsideView | None = None
        self._looked = 0  # step of the last look
        self._pending: _Step | None = None

    def __enter__(self) -> Film:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if error is None:
            self.close()
        self._file.__exit__(kind, error, traceback)

    def close(self) -> None:
        """Finish the file; may be called twice.

        Raises:
            OSError: If the file cannot be written whole.
        """
        with self._file:  # closed even if the last frame cannot be written
            self._write_pending("")

    def watch(self, env: MarsNavEnv, driver: Driver, step: int) -> None:
        """Film one step of an episode.

        Args:
            env: The environment.
            driver: The driver.
            step: Number of the step.
        """
        assert env.course is not None and env.vehicle is not None and env.sight is not None
        if self._pending is not None:
            self._write_pending(_command(env, driver, gave_up=step == self._pending.step))
        if env.gaze.fresh:
            self._looked = step
        if self._view is None or self._view.scene is not env.course.scene:
            self._view = OutsideView(env.course.scene, env.perception.renderer)
        sight, state = env.sight, env.vehicle.state()
        outside = self._view.picture(state, env.vehicle.mesh(env.gaze.pan), step)
        left, normal = sight.left, sight.normal
        if left is None:  # the perception is the ground truth, and took no picture
            picture = env.perception.picture(sight.pose)
            left, normal = picture.left, picture.normal
        elif normal is not None:  # normals mean nothing where the estimator sees sky
            normal = np.where(np.isfinite(sight.depth)[..., None], normal, 0)
        distance = float(np.hypot(*(env.course.goal - state.position[:2])))
        when = "" if self._looked == step else f" of step {self._looked}"
        panels = [
            outside,
            _titled(_square(left), f"left eye{when}"),
            _titled(_with_scale(_square(depth_colours(sight.depth))), _of_step(DEPTH_TITLE, when)),
            _titled(_square(normal_colours(np.zeros(left.shape))), "normals: this perception gives none")
            if normal is None
            else _titled(_square(normal_colours(normal)), _of_step(NORMAL_TITLE, when)),
        ]
        motion = f"step {step}   {_motion(state)}   goal {distance:.1f} m"
        lines = [self.title, motion, _contact(env), _ending(env, driver)]
        ground = partial(map_around, driver, env.rover_spec, env.course.goal[:2], state.pose, env.believed_pose)
        ended = env.outcome != DRIVING
        self._pending = _Step(step, partial(_titled_map, driver, ground), panels, lines, LAST_FRAMES if ended else 1)
        if ended:
            self._write_pending("")

    def _write_pending(self, command: str) -> None:
        """Write the step that was watched last, if it is not written yet.

        Args:
            command: What the driver decided in it; "" if nothing.
        """
        pending, self._pending = self._pending, None
        if pending is None:
            return
        outside, left, depth, normal = pending.panels
        title, motion, contact, ending = pending.lines
        top = [_titled(outside, title, motion, f"{command}   {contact}" if command else contact, ending), left]
        frame = np.vstack([np.hstack(top), np.hstack([depth, normal, pending.ground()])])
        for _ in range(pending.frames):
            self._write(np.ascontiguousarray(frame[..., ::-1]))
        if pending.step % STILL_EVERY == 0:
            self.stills.append(frame)


def _titled_map(driver: Driver, ground: Callable[[], np.ndarray]) -> np.ndarray:
    return _titled(ground(), MAP_TITLE if _navigator(driver) else "map: this driver keeps none")


def navigator_map(env: MarsNavEnv, driver: Driver) -> np.ndarray:
    """Return map_around the rover of an environment, where it is now.

    Args:
        env: The environment, in an episode.
        driver: The driver; the map stays grey if it is no NavigatorDriver.
    """
    assert env.course is not None and env.vehicle is not None
    return map_around(driver, env.rover_spec, env.course.goal[:2], env.vehicle.state().pose, env.believed_pose)


def map_around(
    driver: Driver, spec: RoverSpec, believed_goal: np.ndarray, pose: np.ndarray, believed_pose: np.ndarray
) -> np.ndarray:
    """Return a map around the rover, north up: the navigator's ground, its far path and the goal.

    Everything is drawn at the believed pose, as the map is made from the odometry's poses. Where that is wrong, the
    place that it takes for the goal is drawn as well.

    Args:
        driver: The driver; the map stays grey if it is no NavigatorDriver.
        spec: The rover.
        believed_goal: (2,) goal [m], where the driver drives to by its odometry.
        pose: (4, 4) true pose of the rover.
        believed_pose: (4, 4) its pose by the odometry.

    Returns:
        (PANEL, PANEL, 3) uint8.
    """
    scale = PANEL / MAP_METRES
    canvas = np.full((PANEL, PANEL, 3), UNKNOWN_COLOUR, np.uint8)
    middle, yaw = believed_pose[:2, 3], planar_pose(believed_pose)[2]

    def pixel(xy: np.ndarray) -> tuple[int, int]:
        return round(PANEL / 2 + (xy[0] - middle[0]) * scale), round(PANEL / 2 - (xy[1] - middle[1]) * scale)

    navigator = _navigator(driver)
    if navigator is not None and navigator.ground is not None:
        axis = (np.arange(PANEL) + 0.5) / scale - MAP_METRES / 2
        x, y = np.meshgrid(middle[0] + axis, middle[1] - axis)
        cells = navigator.map.cell_of(np.stack([x, y], axis=-1))
        inside = np.all((cells >= 0) & (cells < navigator.map.n), axis=-1)
        c, r = np.moveaxis(np.where(inside[..., None], cells, 0), -1, 0)
        canvas[inside] = class_colours(navigator.map, navigator.ground)[r, c][inside]
        for xy in navigator.planner.field.path(middle, MAP_METRES):
            cv2.circle(canvas, pixel(xy), 1, (240, 240, 240), -1, cv2.LINE_AA)
    goal = _moved(believed_goal, pose, believed_pose)
    both = bool(np.hypot(*(goal - believed_goal)) > GOAL_ASTRAY)
    places = [(believed_goal, 1, "goal by odometry", -12), (goal, 2, "goal", 21)] if both else [(goal, 2, "", 0)]
    for place, width, name, below in places:
        column, row = (int(np.clip(v, 8, PANEL - 8)) for v in pixel(place))
        cv2.circle(canvas, (column, row), 7, GOAL_COLOUR, width, cv2.LINE_AA)
        text = cv2.getTextSize(name, *TEXT[:2], TEXT[3])[0][0]
        corner = int(np.clip(column - text // 2, 2, PANEL - 2 - text)), int(np.clip(row + below, 16, PANEL - 4))
        for colour, weight in (((18, 18, 20), 3), TEXT[2:4]):
            cv2.putText(canvas, name, corner, *TEXT[:2], colour, weight, cv2.LINE_AA)
    c, s = np.cos(yaw), np.sin(yaw)
    corners = [pixel(corner) for corner in footprint_corners(spec, (*middle, yaw))]
    cv2.polylines(canvas, [np.array(corners, dtype=np.int32)], True, (255, 255, 255), 2, cv2.LINE_AA)
    cv2.line(canvas, pixel(middle), pixel(middle + np.array([c, s])), (255, 255, 255), 2, cv2.LINE_AA)
    left, right, low = PANEL - 12 - round(SCALE_BAR * scale), PANEL - 12, PANEL - 12
    cv2.line(canvas, (left, low), (right, low), (240, 240, 240), 2)
    cv2.putText(canvas, f"{SCALE_BAR:g} m, north up", (left - 20, low - 8), *TEXT)
    return canvas


def _moved(place: np.ndarray, pose: np.ndarray, believed_pose: np.ndarray) -> np.ndarray:
    """Return where the odometry takes a place (2,) of the true world to be, from how the rover stands to it."""
    ahead = pose[:2, :2].T @ (place - pose[:2, 3])
    return np.asarray(believed_pose[:2, :2] @ ahead + believed_pose[:2, 3])


def _motion(state: RoverState) -> str:
    return f"{state.velocity[0]:.2f} m/s   tilt {np.degrees(state.tilt):.0f} deg"


def _command(env: MarsNavEnv, driver: Driver, gave_up: bool) -> str:
    """Return what the driver has just decided: the navigator's status, and the motion."""
    command = driver.command if isinstance(driver, NavigatorDriver) else None
    if command is not None:
        return f"{command.status}: {command.speed:+.2f} m/s {np.degrees(command.yaw_rate):+.0f} deg/s"
    if gave_up:
        return "gives up"
    speed, yaw_rate = env.last_action[:2] * (env.rover_spec.max_speed, env.rover_spec.max_yaw_rate)
    return f"command {speed:+.2f} m/s {np.degrees(yaw_rate):+.0f} deg/s"


def _contact(env: MarsNavEnv) -> str:
    """Return what the rover touched in the last step."""
    assert env.vehicle is not None
    contacts = env.vehicle.contacts()
    touched = [name for name, touches in (("chassis", contacts.chassis), ("wheel", contacts.obstacle)) if touches]
    return f"contact: {' and '.join(touched)}" if touched else "no contact"


def _ending(env: MarsNavEnv, driver: Driver) -> str:
    """Return how the drive ended; "" while it goes on."""
    if env.outcome == DRIVING:
        return ""
    command = driver.command if isinstance(driver, NavigatorDriver) else None
    stuck = env.outcome == "no_path" and command is not None and command.status == "stuck"
    return f"ended: {env.outcome} (recoveries did not help)" if stuck else f"ended: {env.outcome}"


def _navigator(driver: Driver) -> Navigator | None:
    return driver.navigator if isinstance(driver, NavigatorDriver) else None


def _square(image: np.ndarray) -> np.ndarray:
    enlarge = image.shape[0] < PANEL
    return cv2.resize(image, (PANEL, PANEL), interpolation=cv2.INTER_NEAREST if enlarge else cv2.INTER_AREA)


def _with_scale(image: np.ndarray) -> np.ndarray:
    """Draw the scale of depth along the lower edge of a panel."""
    out = np.ascontiguousarray(image)
    margin, height = 12, 10
    bar, columns = depth_bar(PANEL - 2 * margin, height)
    top = PANEL - margin - height
    cv2.rectangle(out, (0, top - 22), (PANEL, PANEL), (18, 18, 20), -1)
    out[top : top + height, margin : PANEL - margin] = bar
    for tick, column in zip(TICKS, columns):
        text = f"{tick} m" if tick == TICKS[-1] else f"{tick}"
        width = cv2.getTextSize(text, *TEXT[:2], TEXT[3])[0][0]
        left = int(np.clip(margin + column - width // 2, 2, PANEL - 2 - width))
        cv2.putText(out, text, (left, top - 6), *TEXT)
        cv2.line(out, (margin + column, top - 3), (margin + column, top + height), TEXT[2], 1)
    return out


def _of_step(title: str, when: str) -> str:
    """Return a title that says of which step the picture is."""
    return title.replace(":", f"{when}:", 1)


def _titled(image: np.ndarray, *lines: str) -> np.ndarray:
    out = np.ascontiguousarray(image)
    shown = [line for line in lines if line]
    cv2.rectangle(out, (0, 0), (out.shape[1], 20 * len(shown)), (18, 18, 20), -1)
    for n, line in enumerate(shown):
        cv2.putText(out, line, (6, 15 + 20 * n), *TEXT)
    return out
