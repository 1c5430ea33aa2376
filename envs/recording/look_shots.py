"""The looks of a recorded drive as the browser's viewer shows them: cloud, believed map, planned path and rover.

The navigator's map and its plans are in the frame of its odometry. They are shown where they lie around the rover, in
the true world, as the ground and the rocks are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from envs.drives.episodes import EpisodeRecord
from envs.drives.shots import LIFT, course_lines, ground_surface, rock_domes
from envs.recording.code_colours import UNKNOWN, WORST, code_colours
from marssim.base.dataset.drive_file import DriveFile, read_drive
from marssim.base.pose import moved, planar_pose
from marssim.base.rover_spec import ZHURONG
from marssim.base.view.clouds import view_of_maps
from marssim.base.view.grids import grid_surface
from marssim.base.view.scene import Layer, Line, Shot, Surface, View
from nav.ground.map_files import TRAVERSABILITY_TITLE
from nav.path.footprint import arc_poses

ABOVE, BELOW = 0.05, 0.03  # [m] of lines above the ground that was measured, and of the map below the points
POINTS = 0.1  # [m] between the points of a motion
COLOURS = {"driven": (60, 110, 190), "planned": (250, 250, 250), "chosen": (30, 90, 220), "rover": (20, 20, 20)}
CONTACT = (230, 40, 30)
ERROR_TITLE = f"depth error: blue too near, red too far, full colour from {100 * WORST:.0f} % on; dark grey without one"


def look_shots(record: EpisodeRecord, path: Path) -> list[Shot]:
    """Return a shot for each look of a recorded drive.

    Args:
        record: The drive.
        path: Its file.

    Raises:
        DatasetError: The file is broken. That of a picture is raised when its shot is loaded.
    """
    drive = read_drive(path, with_pictures=False)
    name = f"{record.cell}, course {record.episode}: {record.driver}, {record.perception}"
    return [
        Shot(f"{name}, step {n}", _eye(drive, step, "pose"), partial(_view, record, path, n), name)
        for n, step in enumerate(drive.steps)
        if step["looked"]
    ]


@lru_cache(maxsize=2)
def _drive(path: Path) -> DriveFile:
    """Return a drive, of which few are kept in memory."""
    return read_drive(path)


def _pose(step: Mapping[str, Any], name: str) -> np.ndarray:
    """Return the pose of a step, (4, 4) body to world; name: "pose" or "believed_pose"."""
    return np.vstack([step[name], [0, 0, 0, 1]])


def _eye(drive: DriveFile, step: Mapping[str, Any], name: str) -> np.ndarray:
    """Return the pose of the left camera, (4, 4) camera to world, by the true or the believed pose of the rover."""
    return np.asarray(_pose(step, name) @ ZHURONG.mount.left_eye(drive.rig.baseline, step["pan"]))


def _view(record: EpisodeRecord, path: Path, n: int) -> View:
    drive = _drive(path)
    step = drive.steps[n]
    depth = drive.depth(n)
    if depth is None:
        raise ValueError(f"{path}: holds no depth of step {n}, at which the rover looked")
    image = _image(drive, n)
    view, pixels = view_of_maps(drive.rig, depth, image, None, drive.confidence(n))
    layers = dict(view.layers)
    if (errors := drive.codes("error", n)) is not None:
        layers["error"] = Layer(code_colours()["error"][errors[pixels]], ERROR_TITLE)
    ground = _Ground.from_step(drive, n)
    if ground is not None:
        eye = _eye(drive, step, "believed_pose")
        places = view.points @ eye[:2, :3].T + eye[:2, 3]
        layers["traversability"] = Layer(ground.colours_at(places), TRAVERSABILITY_TITLE)
    surfaces = (
        ground_surface(record, below=LIFT), rock_domes(record), None if ground is None else ground.surface(),
    )  # fmt: skip
    lines = (*course_lines(record), *_drive_lines(drive, n, ground))
    shown = tuple(part for part in surfaces if part is not None)
    return replace(view, layers=layers, lines=lines, surfaces=shown, note=_note(drive, n))


def _image(drive: DriveFile, n: int) -> np.ndarray | None:
    """Return the left image at the size of the depth, (H, W, 3) uint8 RGB; None if it cannot be read."""
    data = drive.picture("left", n)
    image = None if data is None else cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR_RGB)
    if image is None:
        return None
    camera = drive.rig.camera
    return cv2.resize(image, (camera.width, camera.height), interpolation=cv2.INTER_AREA)


class _Ground:
    """The ground as the navigator judged it at a step, in the frame of its odometry.

    Args:
        codes: (r, r) MAP_CODES, [iy, ix].
        heights: (r, r) highest points [m], NaN where unknown; None for records of earlier releases.
        place: Where it lies: "west", "south" and "cell" [m].
        to_world: (4, 4) odometry's frame to the true world.
    """

    def __init__(
        self, codes: np.ndarray, heights: np.ndarray | None, place: Mapping[str, Any], to_world: np.ndarray
    ) -> None:
        self._codes, self._heights, self._cell, self._to_world = codes, heights, place["cell"], to_world
        self._corner = np.array([place["west"], place["south"]])

    @classmethod
    def from_step(cls, drive: DriveFile, n: int) -> _Ground | None:
        """Return the ground of a step; None where the driver had no map."""
        step, codes, heights = drive.steps[n], drive.codes("map", n), drive.heights(n)
        if codes is None or step["map"] is None:
            return None
        to_world = _pose(step, "pose") @ np.linalg.inv(_pose(step, "believed_pose"))
        return cls(codes[::-1], None if heights is None else heights[::-1], step["map"], to_world)

    def surface(self) -> Surface | None:
        """Return the map as a surface in the world through the middles of its cells; None without heights."""
        if self._heights is None:
            return None
        colours = code_colours()["map"][self._codes]
        first = self._corner + 0.5 * self._cell
        flat = grid_surface("Map of the navigator", first, self._cell, self._heights - BELOW, colours)
        return None if flat is None else replace(flat, vertices=moved(flat.vertices, self._to_world))

    def colours_at(self, places: np.ndarray) -> np.ndarray:
        """Return the colours (N, 3) uint8 of places (N, 2) [m] of the odometry's frame; grey beyond the map."""
        inside, row, column = self._cells(places)
        return np.where(inside[:, None], code_colours()["map"][self._codes[row, column]], np.array(UNKNOWN, np.uint8))

    def on_it(self, places: np.ndarray, level: float) -> np.ndarray:
        """Return places (N, 2) [m] of the odometry's frame a little above the ground, (N, 3) [m] in the world.

        Args:
            places: The places.
            level: Height where none was measured [m].
        """
        inside, row, column = self._cells(places)
        heights = np.full(len(places), np.nan) if self._heights is None else self._heights[row, column]
        heights = np.where(inside & np.isfinite(heights), heights, level)
        return moved(np.column_stack([places, heights + ABOVE]), self._to_world)

    def _cells(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return whether places (N, 2) [m] are on the map, and row and column of their cells, (N,) each."""
        column, row = np.floor((places - self._corner) / self._cell).astype(int).T
        inside = (row >= 0) & (column >= 0) & (row < len(self._codes)) & (column < len(self._codes))
        return inside, np.where(inside, row, 0), np.where(inside, column, 0)


def _drive_lines(drive: DriveFile, n: int, ground: _Ground | None) -> list[Line]:
    """Return the way so far, the rover, and what the navigator planned at a step."""
    step = drive.steps[n]
    lines = []
    if n:
        way = np.array([_pose(other, "pose")[:3, 3] for other in drive.steps[: n + 1]])
        lines.append(Line("Driven path", way + np.array([0, 0, ABOVE]), COLOURS["driven"]))
    ahead, left = drive.content["rover"]["length"] / 2, drive.content["rover"]["width"] / 2
    corners = np.array([[x * ahead, y * left, ABOVE] for x, y in ((1, 1), (1, -1), (-1, -1), (-1, 1), (1, 1))])
    touched = step["contact"] != "none"
    lines.append(Line("Rover", moved(corners, _pose(step, "pose")), CONTACT if touched else COLOURS["rover"]))
    if ground is None:
        return lines
    believed = _pose(step, "believed_pose")
    level = float(believed[2, 3])
    if step["path"] is not None and len(step["path"]) > 1:
        planned = ground.on_it(np.array(step["path"], float), level)
        lines.append(Line("Planned path", planned, COLOURS["planned"]))
    if step["chosen"] is not None and step["candidates"] is not None:
        turn, curvature, end = (step["candidates"][name][step["chosen"]] for name in ("turn", "curvature", "end"))
        if end is not None and end > 0:
            start = planar_pose(believed)
            start[2] += turn
            along = np.linspace(0, end, 2 + int(min(end, 100) / POINTS))
            motion = ground.on_it(arc_poses(start, np.array(curvature), along)[:, :2], level)
            lines.append(Line("Chosen motion", motion, COLOURS["chosen"]))
    return lines


def _note(drive: DriveFile, n: int) -> str:
    """Return what the driver did at a step and why, in a line."""
    step = drive.steps[n]
    words = [f"step {n} of {len(drive.steps) - 1}"]
    decision = ": ".join(word for word in (step["status"], step["reason"]) if word)
    words.append(decision or step["outcome"])
    words.append(f"{step['distance']:.1f} m to the goal")
    if step["abs_rel"] is not None:
        words.append(f"depth error {100 * step['abs_rel']:.1f} %")
    return "; ".join(words)
