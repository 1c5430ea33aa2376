"""Drives of an evaluation as the browser's viewer shows them: ground, rocks that block, and the way of every driver."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from scipy.ndimage import map_coordinates

from envs.drives.colours import OTHER_COLOUR, OUTCOME_COLOURS, ROCK_COLOUR, WAY_COLOUR
from envs.drives.episodes import EpisodeRecord
from marssim.base.camera import NATECAM
from marssim.base.pose import look_pose
from marssim.base.rover_spec import ZHURONG
from marssim.base.view.grids import grid_surface
from marssim.base.view.scene import Line, Shot, Surface, View
from nav.path.footprint import footprint_corners

LIFT = 0.25  # [m] of lines above the ground, which is known every metre alone
POLE = 1.5  # [m] height of the line that marks the goal
LOW, HIGH = np.array([110.0, 84, 62]), np.array([212.0, 176, 138])  # colours of the lowest and the highest ground
RINGS, SECTORS = 4, 12  # of the dome that stands for a rock


def course_shots(records: Sequence[EpisodeRecord]) -> list[Shot]:
    """Return a shot for each course, with the drives of all drivers and perceptions over it.

    Args:
        records: The drives, at least one.
    """
    courses: dict[tuple[str, int], list[EpisodeRecord]] = {}
    for record in records:
        courses.setdefault((record.cell, record.episode), []).append(record)
    return [
        Shot(f"{cell}, course {episode}", _start(drives[0]), partial(_view, drives), f"{cell}, {episode}")
        for (cell, episode), drives in sorted(courses.items())
    ]


def ground_height(record: EpisodeRecord, places: np.ndarray) -> np.ndarray:
    """Return the height of the ground (N,) [m] at places (N, 2) [m], between the heights that a record keeps.

    Records of earlier releases keep none, and are level.
    """
    if not record.relief:
        return np.zeros(len(places))
    heights = np.array(record.relief)
    step = 2 * record.half / (len(heights) - 1)
    column, row = (np.asarray(places, float) + record.half).T / step
    return np.asarray(map_coordinates(heights, [row, column], order=1, mode="nearest"))


def ground_surface(record: EpisodeRecord, below: float = 0.0) -> Surface | None:
    """Return the ground of a course, dark where it is low; None for records that do not say how far it goes.

    Args:
        record: A drive over it.
        below: How far to lower it [m].
    """
    if not record.half:
        return None
    side = max(2, len(record.relief))
    cell = 2 * record.half / (side - 1)
    axis = cell * np.arange(side) - record.half
    places = np.stack(np.meshgrid(axis, axis), axis=-1)
    heights = ground_height(record, places.reshape(-1, 2)).reshape(side, side)
    share = ((heights - heights.min()) / max(float(np.ptp(heights)), 1e-9))[..., None]
    colours = (LOW + (HIGH - LOW) * share).astype(np.uint8)
    return grid_surface("Ground", places[0, 0], cell, heights - below, colours)


def rock_domes(record: EpisodeRecord) -> Surface | None:
    """Return the rocks that block as domes half as high as they are wide; None if there are none."""
    rocks = np.array(record.obstacles, float).reshape(-1, 3)
    if not len(rocks):
        return None
    angle = np.linspace(0, 2 * np.pi, SECTORS, endpoint=False)
    rise = np.linspace(0, np.pi / 2, RINGS, endpoint=False)
    ring = np.stack(np.broadcast_arrays(*(
        np.cos(rise)[:, None] * np.cos(angle), np.cos(rise)[:, None] * np.sin(angle), np.sin(rise)[:, None]
    )), axis=-1).reshape(-1, 3)  # fmt: skip
    dome = np.vstack([ring, [[0, 0, 1]]]) / 2  # of diameter 1 m
    index = np.arange(RINGS * SECTORS).reshape(RINGS, SECTORS)
    low, after = index[:-1], np.roll(index[:-1], -1, axis=1)
    high, high_after = index[1:], np.roll(index[1:], -1, axis=1)
    top = np.full(SECTORS, RINGS * SECTORS)
    faces = np.concatenate([
        np.stack([low, after, high_after], axis=-1).reshape(-1, 3),
        np.stack([low, high_after, high], axis=-1).reshape(-1, 3),
        np.stack([index[-1], np.roll(index[-1], -1), top], axis=-1),
    ])  # fmt: skip
    feet = np.column_stack([rocks[:, :2], ground_height(record, rocks[:, :2])])
    vertices = (feet[:, None] + dome * rocks[:, None, 2:]).reshape(-1, 3)
    shifts = len(dome) * np.arange(len(rocks))[:, None, None]
    colours = np.broadcast_to(np.array(_rgb(ROCK_COLOUR), np.uint8), vertices.shape)
    return Surface("Rocks that block", vertices, (faces + shifts).reshape(-1, 3), colours)


def course_lines(record: EpisodeRecord) -> list[Line]:
    """Return the goal of a course and its shortest passable path."""
    goal = _on_ground(record, np.array([record.goal]))[0]
    lines = [Line("Goal", np.stack([goal, np.add(goal, (0, 0, POLE))]), (200, 30, 160))]
    if len(record.shortest_path) > 1:
        way = _on_ground(record, np.array(record.shortest_path))
        lines.append(Line("Shortest passable path", way, _rgb(WAY_COLOUR)))
    return lines


def _start(record: EpisodeRecord) -> np.ndarray:
    """Return the pose of a camera at the start of a course that looks at its goal, (4, 4)."""
    start, goal = np.array([record.track[0], record.goal])
    low, high = ground_height(record, np.stack([goal, start]))
    along = goal - start
    height = ZHURONG.mount.height
    pitch = np.arctan2(high + height - low, max(float(np.hypot(*along)), 0.1))
    return look_pose(np.array([*start, high + height]), float(np.arctan2(along[1], along[0])), float(pitch))


def _view(drives: Sequence[EpisodeRecord]) -> View:
    first = drives[0]
    lines = course_lines(first)
    for record in drives:
        name = f"{record.driver}, {record.perception}: {record.outcome}"
        colour = _rgb(OUTCOME_COLOURS.get(record.outcome, OTHER_COLOUR))
        track = np.array(record.track)
        if len(track) > 1:
            lines.append(Line(name, _on_ground(record, track), colour))
        if record.headings:
            corners = footprint_corners(ZHURONG, (*track[-1], record.headings[-1]))
            lines.append(Line(name, _on_ground(record, corners[[0, 1, 2, 3, 0]]), colour))
    surfaces = tuple(part for part in (ground_surface(first), rock_domes(first)) if part is not None)
    note = f"goal {first.start_distance:.1f} m from the start, shortest path {first.shortest:.1f} m"
    return View(NATECAM, None, np.zeros((0, 3), np.float32), {}, tuple(lines), surfaces, note, first.start_distance)


def _on_ground(record: EpisodeRecord, places: np.ndarray) -> np.ndarray:
    """Return places (N, 2) [m] a little above the ground, (N, 3) [m]."""
    return np.column_stack([places, ground_height(record, places) + LIFT])


def _rgb(colour: str) -> tuple[int, int, int]:
    red, green, blue = bytes.fromhex(colour.removeprefix("#"))
    return red, green, blue
