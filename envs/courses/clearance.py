"""The clearance between the rover's outline and what blocks it: rocks and steep ground."""

from __future__ import annotations

import cv2
import numpy as np

from envs.courses.course import CELL
from marssim.base.angle import wrapped
from marssim.base.rover_spec import RoverSpec
from marssim.scene.rocks.outlines import outline_points
from marssim.scene.scene import Scene

SPACING = 0.03  # [m] between points of an outline; it makes distances at 0.1 m too large by a millimetre at most
BETWEEN = 0.05  # [m] that the footprint's corners move between two checks of a drive
FAR = 3.0  # [m] largest clearance; rocks farther away are not searched


class ObstacleClearance:
    """Distance between the rover and its obstacles, both seen from above.

    The rover is its driving footprint, length x width, at any heading. An obstacle is a rock or block of
    obstacle_height or more, whose outline is that of its mesh above ground, or steep ground, taken as the middles of
    its cells.
    """

    def __init__(self, scene: Scene, spec: RoverSpec, steep: np.ndarray) -> None:
        """Collect the outlines.

        Args:
            scene: The scene.
            spec: The rover.
            steep: (n, n) bool, the steep ground of TrueGround.
        """
        self._half = np.array([spec.length, spec.width]) / 2
        rocks = scene.bodies
        reached = np.abs(rocks.centre[:, :2]).max(axis=1) - rocks.diameter < scene.half
        block = np.flatnonzero((rocks.height >= spec.obstacle_height) & reached)
        points, owner = outline_points(rocks, block, scene.terrain.height_at)
        order = np.argsort(owner, kind="stable")
        outlines = np.split(points[order], np.flatnonzero(np.diff(owner[order])) + 1)
        hulls = [_hull_points(outline) for outline in outlines if len(outline) > 2]
        around = np.concatenate([np.argwhere(steep)[:, ::-1] * CELL - scene.half, *hulls])
        self._outlines = around[np.argsort(around[:, 0])]

    def between(self, before: np.ndarray, after: np.ndarray) -> float:
        """Return the least distance from the footprint to an outline on the way between two places, turning evenly.

        Args:
            before: (3,) x, y [m] and yaw [rad] at the start.
            after: (3,) the same at the end.

        Returns:
            Distance [m]; 0 where they overlap, FAR where nothing comes as near.
        """
        turn = wrapped(after[2] - before[2])
        change = np.array([*(after[:2] - before[:2]), turn])
        corner = float(np.hypot(*self._half))
        moved = float(np.hypot(*change[:2]))
        number = int(np.ceil((moved + abs(turn) * corner) / BETWEEN)) + 1
        places = before + np.linspace(0, 1, number)[:, None] * change
        near = self._within(before[:2] + change[:2] / 2, FAR + corner + moved / 2)
        away = near - places[:, None, :2]  # (places, points, 2)
        c, s = np.cos(places[:, 2:]), np.sin(places[:, 2:])
        ahead, left = c * away[..., 0] + s * away[..., 1], c * away[..., 1] - s * away[..., 0]
        beyond = np.hypot(np.maximum(np.abs(ahead) - self._half[0], 0), np.maximum(np.abs(left) - self._half[1], 0))
        return float(beyond.min(initial=FAR))

    def _within(self, middle: np.ndarray, reach: float) -> np.ndarray:
        """Return the points (n, 2) of the outlines in a square of side 2 reach [m]."""
        low, high = np.searchsorted(self._outlines[:, 0], (middle[0] - reach, middle[0] + reach))
        strip = self._outlines[low:high]
        return strip[np.abs(strip[:, 1] - middle[1]) <= reach]


def _hull_points(points: np.ndarray) -> np.ndarray:
    """Return points (n, 2) along the convex hull of points (m, 2) [m], at most SPACING apart."""
    corners = cv2.convexHull(points.astype(np.float32))[:, 0].astype(float)
    sides = np.roll(corners, -1, axis=0) - corners
    number = np.ceil(np.hypot(*sides.T) / SPACING).astype(int).clip(1)
    along = (np.arange(number.sum()) - np.repeat(np.cumsum(number) - number, number)) / np.repeat(number, number)
    return np.asarray(np.repeat(corners, number, axis=0) + along[:, None] * np.repeat(sides, number, axis=0))
