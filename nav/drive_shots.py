"""Steps of the navigator as the browser's viewer shows them: the cloud that it saw, its map, and what it chose."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from marssim.base.camera import StereoRig
from marssim.base.rover_spec import RoverSpec
from marssim.base.view.clouds import view_of_maps
from marssim.base.view.grids import grid_surface
from marssim.base.view.scene import Layer, Line, Shot, Surface, View
from nav.command import Command
from nav.ground.map_files import TRAVERSABILITY_TITLE, UNKNOWN_COLOUR, class_colours
from nav.navigator import Navigator

POLE = 1.5  # [m] height of the line that marks the goal
LIFT = 0.05  # [m] of the chosen motion above the ground
MAP_BELOW = 0.03  # [m] of the map below its heights, so that the cloud lies on it
GOAL_COLOUR, MOTION_COLOUR = (200, 30, 160), (30, 90, 220)


@dataclass(frozen=True)
class MapState:
    """What the navigator believed of the ground in one step, cut to what it had seen.

    Attributes:
        origin: (2,) world position of the lower left corner [m].
        cell: Edge of a cell [m].
        heights: (r, c) float32 height of the highest points [m], [iy, ix]; NaN where unknown.
        colours: (r, c, 3) uint8 RGB of traversability; None before the ground was judged.
    """

    origin: np.ndarray
    cell: float
    heights: np.ndarray
    colours: np.ndarray | None

    @classmethod
    def from_navigator(cls, navigator: Navigator) -> MapState | None:
        """Copy the state of a navigator; None if its map is empty."""
        elevation, ground = navigator.map, navigator.ground
        rows, columns = np.nonzero(elevation.measured)
        if not rows.size:
            return None
        part = np.s_[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
        heights = np.where(elevation.measured, elevation.top, np.float32(np.nan))[part]
        colours = None if ground is None else class_colours(elevation, ground)[part].copy()
        cell = elevation.config.cell
        return cls(elevation.origin + cell * np.array([columns.min(), rows.min()]), cell, heights, colours)

    def cells(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return row and column of the cells of places (N, 2) [m], and whether they are in the map, (N,) each."""
        column, row = np.floor((places - self.origin) / self.cell).astype(int).T
        inside = (row >= 0) & (column >= 0) & (row < self.heights.shape[0]) & (column < self.heights.shape[1])
        return np.where(inside, row, 0), np.where(inside, column, 0), inside

    def colours_at(self, places: np.ndarray) -> np.ndarray:
        """Return the colours of traversability at places (N, 2) [m], (N, 3) uint8; grey beyond the map."""
        assert self.colours is not None
        row, column, inside = self.cells(places)
        return np.where(inside[:, None], self.colours[row, column], np.array(UNKNOWN_COLOUR, np.uint8))

    def surface(self) -> Surface | None:
        """Return the map as a surface through the middles of its cells; None without four seen cells in a square."""
        if self.colours is None:
            return None
        first = self.origin + 0.5 * self.cell
        return grid_surface("Map of the navigator", first, self.cell, self.heights - MAP_BELOW, self.colours)


class DriveRecorder:
    """Keeps what a page shows of each step of the navigator.

    Attributes:
        shots: The steps so far.

    Args:
        goal: (2,) goal in the world [m].
        spec: The rover.
    """

    def __init__(self, goal: np.ndarray, spec: RoverSpec) -> None:
        self.shots: list[Shot] = []
        self._frames = 0  # of the drive so far, with depth or without
        self._goal, self._spec = goal, spec

    def add(
        self,
        navigator: Navigator,
        command: Command,
        rig: StereoRig,
        camera_pose: np.ndarray,
        depth: np.ndarray | None,
        confidence: np.ndarray | None,
        image: np.ndarray | None,
    ) -> None:
        """Add the step that the navigator has just made.

        Args:
            navigator: Its map and motion are copied.
            command: What it commanded.
            rig: The cameras at the size of `depth`.
            camera_pose: (4, 4) left camera to world.
            depth: (H, W) [m]; None: no image was taken, so there is nothing to show.
            confidence: (H, W), 0 to 1, or None.
            image: (H, W, 3) uint8 RGB left image, or None.
        """
        number, self._frames = self._frames, self._frames + 1
        if depth is None:
            return
        ground = camera_pose[2, 3] - self._spec.mount.height
        foot = np.array([*self._goal[:2], ground])
        lines = [Line("Goal", np.stack([foot, np.add(foot, (0, 0, POLE))]), GOAL_COLOUR)]
        state = MapState.from_navigator(navigator)
        if command.status in ("drive", "turn") and navigator.motion is not None and state is not None:
            lines.append(Line("Chosen motion", _on_ground(navigator.motion.poses, state, ground), MOTION_COLOUR))
        note = f"{command.status}, {command.speed:.2f} m/s, {np.rad2deg(command.yaw_rate):+.1f} deg/s"
        load = partial(_view, rig, camera_pose, depth, confidence, image, state, tuple(lines), note)
        self.shots.append(Shot(f"frame {number}", camera_pose, load))


def _on_ground(poses: np.ndarray, state: MapState, ground: float) -> np.ndarray:
    """Return the points (k, 3) [m] of a motion (k, 3) on the map, or at the height `ground` beyond it."""
    row, column, inside = state.cells(poses[:, :2])
    heights = np.where(inside, state.heights[row, column], np.nan)
    return np.column_stack([poses[:, :2], np.where(np.isfinite(heights), heights, ground) + LIFT])


def _view(
    rig: StereoRig,
    pose: np.ndarray,
    depth: np.ndarray,
    confidence: np.ndarray | None,
    image: np.ndarray | None,
    state: MapState | None,
    lines: tuple[Line, ...],
    note: str,
) -> View:
    view, _ = view_of_maps(rig, depth, image, None, confidence)
    if state is None or state.colours is None:
        return replace(view, lines=lines, note=note)
    places = view.points @ pose[:2, :3].T + pose[:2, 3]
    layers = {"traversability": Layer(state.colours_at(places), TRAVERSABILITY_TITLE), **view.layers}
    surface = state.surface()
    return replace(view, layers=layers, lines=lines, surfaces=() if surface is None else (surface,), note=note)
