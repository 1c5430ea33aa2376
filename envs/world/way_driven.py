"""The way that the rover has driven in an episode: its length, its clearance, and the progress to the goal."""

from __future__ import annotations

import numpy as np

from envs.courses.clearance import ObstacleClearance
from envs.courses.course import Course


class WayDriven:
    """The true way of an episode so far.

    Attributes:
        place: (3,) x, y [m] and yaw [rad] of the rover now.
        length: Length of the way [m].
        clearance: Least distance in the last step between the footprint and an obstacle [m].
        min_clearance: Least distance on it between the footprint and an obstacle [m].
        to_go: Length of the shortest passable way from the place to the goal [m]; inf where none leads there.
    """

    def __init__(self, course: Course, obstacles: ObstacleClearance, start: np.ndarray) -> None:
        """Begin at the start.

        Args:
            course: The course.
            obstacles: The obstacles of its scene.
            start: (3,) x, y [m] and yaw [rad].
        """
        self._ground, self._obstacles = course.ground, obstacles
        self.place = start
        self.length = 0.0
        self.clearance = self.min_clearance = obstacles.between(start, start)
        self.to_go = self._last_to_go = self._ground.distance_to_goal(*start[:2])

    def advance(self, place: np.ndarray) -> float:
        """Add a step, which ends at a place (3,): x, y [m] and yaw [rad].

        Returns:
            How much shorter the passable way to the goal has become [m]; 0 where no way leads there.
        """
        self.length += float(np.hypot(*(place - self.place)[:2]))
        self.clearance = self._obstacles.between(self.place, place)
        self.min_clearance = min(self.min_clearance, self.clearance)
        self.place = place
        self.to_go = self._ground.distance_to_goal(*place[:2])
        if not np.isfinite(self.to_go):
            return 0.0
        progress, self._last_to_go = self._last_to_go - self.to_go, self.to_go
        return progress
