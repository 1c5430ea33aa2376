"""Why a drive of the navigator failed: its map beside the map that true depth gives from the same places."""

from __future__ import annotations

from copy import deepcopy

import cv2
import numpy as np

from envs.drives.episodes import Cause
from envs.mars_nav import MarsNavEnv
from envs.world.referee import DRIVING
from marssim.base.pose import planar_pose
from nav.ground.elevation import LAYERS, ElevationMap
from nav.ground.traversability import assess
from nav.navigator import Navigator
from nav.path.footprint import footprint_discs
from nav.path.open_path import is_open
from nav.path.planner import Planner

TOUCHED = 0.3  # [m] from the footprint, within which a true obstacle may be what the rover hit
SAME_POSE = 1e-6  # [m] rounding of odometry that does not err
SAME_OBSTACLE = 0.2  # [m] within which an obstacle on the other map is the same
IN_WORDS = {
    Cause.ODOMETRY: "its odometry erred",
    Cause.KNOWN_OBSTACLE: "it hit, or tilted on, an obstacle that its map shows",
    Cause.MISSED_OBSTACLE: "it hit, or tilted on, an obstacle that its map lacks and that of true depth shows",
    Cause.UNSEEN_OBSTACLE: "it hit, or tilted on, something that even the map of true depth does not show",
    Cause.FALSE_OBSTACLES: "obstacles that are not there blocked its path",
    Cause.UNMEASURED_GROUND: "ground without depth blocked its path",
    Cause.BOTH: "obstacles that are not there and ground without depth blocked its path",
    Cause.OTHER_ERRORS: "other errors of its map blocked its path",
    Cause.NO_TRUE_PATH: "on the map of true depth, no path was open either",
    Cause.NO_PROGRESS: "a path was open on its map, but it did not move on",
    Cause.DETOUR: "a path was open, but it had taken too long or left the ground",
}
"""The causes in words, as the rest of a sentence that begins with a colon."""


class TrueDepthMap:
    """The map that a navigator would have if it saw true depth from the places of a drive.

    Call `see` after the reset and after each step that does not end the drive, and `cause` at its end.
    """

    def __init__(self, navigator: Navigator) -> None:
        """Make the map of a navigator that has seen nothing yet."""
        self._navigator = navigator
        self._map = ElevationMap(navigator.config.elevation)
        self._at_true_places: ElevationMap | None = None  # from when on the odometry errs
        self._started = False

    def see(self, env: MarsNavEnv) -> None:
        """Put the true depth of the present look on the map."""
        assert env.sight is not None and env.vehicle is not None
        pose, true_pose, sight = env.believed_pose, env.vehicle.state().pose, env.sight
        if not self._started:
            self._map.clear(pose[:2, 3])
            self._map.assume_flat(pose, self._navigator.config.clear_radius)
            self._started = True
        if self._at_true_places is None and np.abs(pose - true_pose).max() > SAME_POSE:
            self._at_true_places = deepcopy(self._map)
        eye = pose @ self._navigator.spec.mount.left_eye(sight.rig.baseline, env.gaze.pan)
        self._add(self._map, pose, eye, env)
        if self._at_true_places is not None:
            self._add(self._at_true_places, true_pose, sight.pose, env)

    def _add(self, elevation: ElevationMap, pose: np.ndarray, eye: np.ndarray, env: MarsNavEnv) -> None:
        """Put the true depth of the present look on a map, from poses (4, 4) of the rover and its left eye."""
        spec, sight = self._navigator.spec, env.sight
        elevation.recentre(pose[:2, 3])
        elevation.assume_under(pose, spec.length, spec.width)
        if env.gaze.fresh and sight is not None and sight.true_depth is not None:
            elevation.integrate(sight.true_depth, None, sight.rig, eye, spec.mount.height)

    def cause(self, env: MarsNavEnv) -> Cause | None:
        """Return why the drive failed that has just ended.

        It is None for a drive that reached the goal, for a navigator that has not decided anything, and for one that
        knew heights before the drive, as its map then shows more than its depth.
        """
        assert env.course is not None
        if env.outcome in ("goal", DRIVING) or not self._started or self._navigator.prior is not None:
            return None
        place, area = planar_pose(env.believed_pose), env.course.area
        inside = area[0] <= place[0] <= area[2] and area[1] <= place[1] <= area[3]
        if env.outcome == "elsewhere" or (env.outcome == "out_of_bounds" and inside):
            return Cause.ODOMETRY
        if env.outcome in ("collision", "tilt"):
            assert env.vehicle is not None
            return self._cause_of_contact(place, planar_pose(env.vehicle.state().pose))
        cause = self._cause_of_blocked_path(place, np.asarray(env.course.goal, dtype=float)[:2])
        return Cause.NO_PROGRESS if cause is Cause.DETOUR and env.outcome == "stuck" else cause

    def _cause_of_contact(self, place: np.ndarray, true_place: np.ndarray) -> Cause:
        """Return the cause of a contact: whether the maps show the obstacle that is nearest there.

        The rules are those without extra risk: what the navigator drove over on purpose was known to it.

        Args:
            place: (3,) where the navigator believes to be.
            true_place: (3,) where the rover is.
        """
        rows, columns = self._touched(self._map, place)
        if not len(rows):
            other = self._at_true_places
            shown = other is not None and len(self._touched(other, true_place)[0])
            return Cause.ODOMETRY if shown else Cause.UNSEEN_OBSTACLE
        spec, rules = self._navigator.spec, self._navigator.config.traversability
        beside = assess(self._navigator.map, spec, rules).clearance[rows, columns]
        return Cause.KNOWN_OBSTACLE if beside.min() <= SAME_OBSTACLE else Cause.MISSED_OBSTACLE

    def _touched(self, elevation: ElevationMap, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return rows and columns of the obstacle that is nearest to a place (3,); none if it is beyond TOUCHED."""
        cells = np.argwhere(assess(elevation, self._navigator.spec, self._navigator.config.traversability).blocked)
        x, y = elevation.centres()
        room = _room(np.column_stack([x[cells[:, 1]], y[cells[:, 0]]]), place, self._navigator)
        nearest = room.min(initial=np.inf)
        rows, columns = cells[(room <= nearest + elevation.config.cell) & (nearest <= TOUCHED)].T
        return rows, columns

    def _cause_of_blocked_path(self, place: np.ndarray, goal: np.ndarray) -> Cause:
        navigator, estimated, true = self._navigator, self._navigator.map, self._map
        planner = Planner(navigator.spec, navigator.config.planner, estimated)
        planner.margin = navigator.planner.margin

        def opens(elevation: ElevationMap, passable: np.ndarray | None = None) -> bool:
            return is_open(planner, elevation, navigator.judge(place, elevation, passable), place, goal)

        if opens(estimated):
            return Cause.DETOUR
        if not opens(true):
            return Cause.NO_TRUE_PATH
        # Beside heights that err, a true height is a step: cells that are free with true depth are passed as passable.
        # The wheels meet the neighbours of the cells that they are on.
        true_ground = navigator.judge(place, true)
        blocked, free = navigator.judge(place).blocked, true_ground.known & ~true_ground.blocked
        false, gaps = blocked & free, ~estimated.measured & true.measured
        around = true.measured & (cv2.dilate(false.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0)
        if opens(_corrected(estimated, true, around), free):
            return Cause.FALSE_OBSTACLES
        if opens(_corrected(estimated, true, gaps), free & ~blocked):
            return Cause.UNMEASURED_GROUND
        return Cause.BOTH if opens(_corrected(estimated, true, around | gaps), free) else Cause.OTHER_ERRORS


def _corrected(estimated: ElevationMap, true: ElevationMap, where: np.ndarray) -> ElevationMap:
    """Return a copy of a map with the cells of another one in a mask (n, n)."""
    out = deepcopy(estimated)
    for name in LAYERS:
        getattr(out, name)[where] = getattr(true, name)[where]
    return out


def _room(points: np.ndarray, place: np.ndarray, navigator: Navigator) -> np.ndarray:
    """Return the distances (m,) [m] of points (m, 2) from the discs that cover the footprint at a place (3,)."""
    centres, radius = footprint_discs(navigator.spec)
    c, s = np.cos(place[2]), np.sin(place[2])
    discs = place[:2] + centres @ np.array([[c, s], [-s, c]])
    return np.asarray(np.hypot(*(points[:, None] - discs).transpose(2, 0, 1)).min(axis=1) - radius)
