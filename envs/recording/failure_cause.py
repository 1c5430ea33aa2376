"""Why a drive of the navigator failed: its map beside the map that true depth gives from the same places."""

from __future__ import annotations

from copy import deepcopy
from enum import StrEnum

import numpy as np

from envs.drivers.builtin import NavigatorDriver
from envs.drivers.driver import Driver
from envs.mars_nav import MarsNavEnv
from nav.ground.elevation import ElevationMap
from nav.ground.traversability import Traversability, assess
from nav.navigator import Navigator
from nav.path.footprint import footprint_distance
from nav.path.open_path import is_open
from nav.path.planner import Planner

TOUCHED = 0.3  # [m] from the footprint, within which a cell belongs to what the rover hit: contacts, cells and map err
DRIVING = "driving"  # outcome of a drive that goes on


class Cause(StrEnum):
    """Why a drive failed."""

    ODOMETRY = "odometry error"
    """It ended away from the goal, as the rover's odometry erred."""
    KNOWN_OBSTACLE = "known obstacle"
    """It hit, or tilted on, an obstacle that the navigator's map shows."""
    MISSED_OBSTACLE = "missed obstacle"
    """It hit, or tilted on, an obstacle that the navigator's map lacks, and that of true depth shows."""
    UNSEEN_OBSTACLE = "unseen obstacle"
    """It hit, or tilted on, something that even the map of true depth does not show as an obstacle."""
    FALSE_OBSTACLES = "false obstacles"
    """Obstacles that are not there block the path: without them, a path is open."""
    UNMEASURED_GROUND = "unmeasured ground"
    """Ground without depth blocks the path: with its true heights, a path is open."""
    BOTH = "false obstacles and unmeasured ground"
    """False obstacles and unmeasured ground block the path together, and neither does alone."""
    NO_TRUE_PATH = "no path with true depth"
    """On the map of true depth, no path is open either."""
    DETOUR = "detour"
    """A path was open when the drive ended: it had taken too long, or led out of the ground."""


IN_WORDS = {
    Cause.ODOMETRY: "its odometry erred",
    Cause.KNOWN_OBSTACLE: "it hit, or tilted on, an obstacle that its map shows",
    Cause.MISSED_OBSTACLE: "it hit, or tilted on, an obstacle that its map lacks and that of true depth shows",
    Cause.UNSEEN_OBSTACLE: "it hit, or tilted on, something that even the map of true depth does not show",
    Cause.FALSE_OBSTACLES: "obstacles that are not there blocked its path",
    Cause.UNMEASURED_GROUND: "ground without depth blocked its path",
    Cause.BOTH: "obstacles that are not there and ground without depth blocked its path together",
    Cause.NO_TRUE_PATH: "on the map of true depth, no path was open either",
    Cause.DETOUR: "a path was open, but it had taken too long or left the ground",
}
"""The causes in words, as the rest of a sentence that begins with a colon."""


class TrueDepthBeside:
    """A second navigator that sees true depth from the places of a drive, and whose commands nobody follows.

    Call `see` after the reset and after each step that does not end the drive, and `cause` at its end.
    """

    def __init__(self, env: MarsNavEnv) -> None:
        """Make one for the drive that an environment begins."""
        assert env.course is not None
        self._navigator = Navigator(env.rover_spec, area=env.course.area)

    def see(self, env: MarsNavEnv) -> None:
        """Put the true depth of the present look on the second map."""
        assert env.sight is not None and env.course is not None
        sight = env.sight
        self._navigator.step(
            sight.true_depth, None, sight.rig, env.believed_pose, env.course.goal, env.gaze.pan,
            between_looks=not env.gaze.fresh,
        )  # fmt: skip

    def cause(self, env: MarsNavEnv, driver: Driver) -> Cause | None:
        """Return why the drive failed that has just ended.

        It is None for a drive that reached the goal, and for a driver that is not the navigator or has not decided yet.
        """
        if not isinstance(driver, NavigatorDriver) or driver.command is None or env.course is None:
            return None
        if env.outcome in ("goal", DRIVING):
            return None
        if env.outcome == "elsewhere":
            return Cause.ODOMETRY
        pose = env.believed_pose
        place = np.array([pose[0, 3], pose[1, 3], np.arctan2(pose[1, 0], pose[0, 0])])
        if env.outcome in ("collision", "tilt"):
            return self._cause_of_contact(driver.navigator, place)
        return self._cause_of_blocked_path(driver.navigator, place, np.asarray(env.course.goal, dtype=float)[:2])

    def _cause_of_contact(self, navigator: Navigator, place: np.ndarray) -> Cause:
        true = self._navigator.map
        if _is_touched(navigator, navigator.map, place):
            return Cause.KNOWN_OBSTACLE
        return Cause.MISSED_OBSTACLE if _is_touched(navigator, true, place) else Cause.UNSEEN_OBSTACLE

    def _cause_of_blocked_path(self, navigator: Navigator, place: np.ndarray, goal: np.ndarray) -> Cause:
        believed, true = navigator.map, self._navigator.map
        planner = Planner(navigator.spec, navigator.config.planner, believed)
        planner.margin = navigator.planner.margin

        def opens(elevation: ElevationMap, ground: Traversability) -> bool:
            return is_open(planner, elevation, ground, place, goal)

        seen, really = navigator.judge(place), navigator.judge(place, true)
        if opens(believed, seen):
            return Cause.DETOUR
        if not opens(true, really):
            return Cause.NO_TRUE_PATH
        false = seen.blocked & really.known & ~really.blocked
        if opens(believed, navigator.judge(place, freed=false)):
            return Cause.FALSE_OBSTACLES
        completed = deepcopy(believed)
        completed.complete(true)
        if opens(completed, navigator.judge(place, completed)):
            return Cause.UNMEASURED_GROUND
        return Cause.BOTH


def _is_touched(navigator: Navigator, elevation: ElevationMap, place: np.ndarray) -> bool:
    """Return whether a map shows an obstacle under or beside the rover at a place (3,), where it hit something.

    The rules are those without extra risk: what the navigator drove over on purpose was known to it.
    """
    ground = assess(elevation, navigator.spec, navigator.config.traversability)
    return bool(footprint_distance(ground.clearance, elevation, place, navigator.spec) < TOUCHED)
