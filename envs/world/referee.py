"""The end of an episode: at the goal, against a rock, tilted, out of bounds, stuck, or out of time."""

from __future__ import annotations

import numpy as np

from envs.courses.course import EDGE, Course
from envs.world.vehicle import Vehicle
from marssim.base.rover_spec import RoverSpec

GOAL_ASTRAY = 0.1  # [m] between the goal and where the odometry takes it to be, from which both are shown
GOAL_RADIUS = 1.0  # [m] within which the goal is reached
STUCK_STEPS, STUCK_DISTANCE = 5, 0.1  # steps, and [m] below which the rover is stuck
STUCK_SPEED = 0.25  # share of the full speed from which a command is one to drive
DRIVING = "driving"  # the outcome of a drive that goes on
STEPS_PER_METRE = 15  # time limit: six times what the straight path takes at full speed


class Referee:
    """Judges a drive after each of its steps.

    Attributes:
        time_limit: Most steps of the drive.
    """

    def __init__(self, course: Course, spec: RoverSpec, goal_distance: float) -> None:
        self.spec, self._goal = spec, course.goal  # not the course, whose scene would stay in memory with it
        self._reach = course.scene.half - EDGE
        self.time_limit = round(STEPS_PER_METRE * goal_distance)
        self._places = [course.start[:2]]  # the rover's places since the last command to stand or turn

    def judge(self, vehicle: Vehicle, speed: float, steps: int) -> str:
        """Return the state of the episode: an outcome as MarsNavEnv names it, DRIVING while it goes on.

        Args:
            vehicle: The rover.
            speed: Commanded speed of the last step [m/s].
            steps: Number of steps so far.
        """
        state = vehicle.state()
        position = np.array(state.position[:2], dtype=float)
        if vehicle.contacts().collision:
            return "collision"
        if state.tilt > self.spec.max_tilt:
            return "tilt"
        if float(np.hypot(*(position - self._goal))) <= GOAL_RADIUS:
            return "goal"
        if np.abs(position).max() > self._reach:
            return "out_of_bounds"
        if self._stuck(position, speed):
            return "stuck"
        return "time" if steps >= self.time_limit else DRIVING

    def _stuck(self, position: np.ndarray, speed: float) -> bool:
        if abs(speed) < STUCK_SPEED * self.spec.max_speed:
            self._places = [position]
            return False
        self._places = [*self._places[-STUCK_STEPS:], position]
        moved = np.hypot(*(np.array(self._places) - self._places[0]).T)  # a rover that returns to a place is not stuck
        return len(self._places) > STUCK_STEPS and float(moved.max()) < STUCK_DISTANCE
