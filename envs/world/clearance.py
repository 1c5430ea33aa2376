"""How near the rover's outline comes to the rocks that block it."""

from __future__ import annotations

import cv2
import numpy as np

from marssim.base.rover_spec import RoverSpec
from marssim.scene.rocks import outline_points
from marssim.scene.scene import Scene

SPACING = 0.03  # [m] between points of an outline; at 0.1 m distances come out a millimetre too large at most
BETWEEN = 0.05  # [m] that the footprint's corners move between two looks at a drive
FAR = 3.0  # [m]; what is farther away is not looked for


class RockClearance:
    """Distance between the rover and what blocks it, both seen from above.

    The rover is its driving footprint, length x width, at any heading; an obstacle is a rock of obstacle_height or
    more, and its outline that of its mesh above ground.
    """

    def __init__(self, scene: Scene, spec: RoverSpec) -> None:
        self._half = np.array([spec.length, spec.width]) / 2
        rocks = scene.rocks
        reached = np.abs(rocks.centre[:, :2]).max(axis=1) - rocks.diameter < scene.half
        block = np.flatnonzero((rocks.height >= spec.obstacle_height) & reached)
        points, of = outline_points(rocks, block, scene.terrain.height_at)
        order = np.argsort(of, kind="stable")
        outlines = np.split(points[order], np.flatnonzero(np.diff(of[order])) + 1)
        around = np.concatenate([np.zeros((0, 2)), *(_walked(outline) for outline in outlines if len(outline) > 2)])
        self._outlines = around[np.argsort(around[:, 0])]

    def between(self, before: np.ndarray, after: np.ndarray) -> float:
        """Least distance [m] from the footprint to an outline on the way between two places, turning evenly.

        before, after: (3,) x, y [m] and yaw [rad]. 0 where they overlap, FAR where nothing comes as near.
        """
        turn = (after[2] - before[2] + np.pi) % (2 * np.pi) - np.pi
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
        """Points (n, 2) of the outlines in a square of 2 reach [m]."""
        low, high = np.searchsorted(self._outlines[:, 0], (middle[0] - reach, middle[0] + reach))
        strip = self._outlines[low:high]
        return strip[np.abs(strip[:, 1] - middle[1]) <= reach]


def _walked(points: np.ndarray) -> np.ndarray:
    """(n, 2): the convex hull of points (m, 2) [m], walked round in steps of SPACING at most."""
    corners = cv2.convexHull(points.astype(np.float32))[:, 0].astype(float)
    sides = np.roll(corners, -1, axis=0) - corners
    number = np.ceil(np.hypot(*sides.T) / SPACING).astype(int).clip(1)
    along = (np.arange(number.sum()) - np.repeat(np.cumsum(number) - number, number)) / np.repeat(number, number)
    return np.asarray(np.repeat(corners, number, axis=0) + along[:, None] * np.repeat(sides, number, axis=0))
