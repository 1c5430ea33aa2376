"""Recovery where no way leads on: look to both sides, back out along the track, turn, or give up.

Dead ends and bumps are remembered, so that the next plan leads elsewhere.
"""

from __future__ import annotations

import numpy as np

from marssim.base.rover_spec import RoverSpec
from nav.command import Command
from nav.config import NavigatorConfig
from nav.controller import steerable
from nav.ground.elevation import ElevationMap
from nav.ground.traversability import Traversability
from nav.mast import PAN_TOLERANCE
from nav.path.footprint import arc_poses
from nav.path.planner import Planner

TRACK_STEP = 0.2  # [m] between two points of the driven track
BUMP_AHEAD = 0.15  # [m] from the rover's front to the thing that it bumped into
DEAD_END_AHEAD = 0.5  # [m] from the rover's middle to the place that is noted as a dead end
TRACK_REACHED = 0.5  # [m] within which a point of the track counts as reached on the way back
TRACK_BEHIND = 0.1  # [m] that a point of the track must lie behind the rover's middle to be driven to
STALLED = 0.02  # [m] in a step, below which the rover is not backing out
CHECKED_POSES = 4  # number of poses of a step back that are checked


class Recovery:
    """The driven track, and the ways back.

    Attributes:
        bumps: World positions (2,) [m] of what the rover bumped into.
        dead_ends: World positions (2,) [m] of dead ends.
        attempts: Recoveries begun since the rover last came nearer to the goal.
    """

    def __init__(self, spec: RoverSpec, config: NavigatorConfig) -> None:
        self.spec, self.config = spec, config
        self.bumps: list[np.ndarray] = []
        self.dead_ends: list[np.ndarray] = []
        self.attempts = 0
        self._track: list[np.ndarray] = []
        self._pans_to_look: list[float] | None = None
        self._back_left = 0.0

    @property
    def backing(self) -> bool:
        """Whether the rover is driving back."""
        return self._back_left > 0

    @property
    def back_left(self) -> float:
        """Distance that is left to drive back [m]."""
        return self._back_left

    @property
    def looking(self) -> bool:
        """Whether the mast is looking to the sides at a dead end."""
        return self._pans_to_look is not None

    def follow(self, place: np.ndarray) -> None:
        """Note where the rover is: (3,) x, y [m], yaw [rad]."""
        if not self._track or np.hypot(*(place - self._track[-1])[:2]) > TRACK_STEP:
            self._track.append(place)

    def count(self, place: np.ndarray, moved: float, last: Command) -> None:
        """Count the way that the last command drove back, of which there may be no image; it ends where nothing moves.

        Args:
            place: (3,) x, y [m], yaw [rad] of the rover now.
            moved: Distance from the place of the step before [m].
            last: The command of that step.
        """
        if last.status == "recover" and last.speed < 0:
            self._back_left = 0.0 if moved < STALLED else max(self._back_left - moved, 0.0)
            self._drop_reached(place)

    def _drop_reached(self, place: np.ndarray) -> None:
        while len(self._track) > 1 and np.hypot(*(place - self._track[-1])[:2]) < TRACK_REACHED:
            self._track.pop()

    def skip_look(self) -> None:
        """Take the look that was asked for last as done, where another driver moves the mast."""
        if self._pans_to_look:
            self._pans_to_look.pop(0)

    def found_a_way(self) -> None:
        """Note that a way leads on, so that the mast looks to both sides at the next dead end."""
        self._pans_to_look = None

    def bump(self, place: np.ndarray) -> None:
        """Note that the rover drives and does not move: something that it did not see stands in front of it."""
        ahead = self.spec.length / 2 + BUMP_AHEAD
        self.bumps.append(place[:2] + ahead * np.array([np.cos(place[2]), np.sin(place[2])]))
        self.start(place)

    def start(self, place: np.ndarray) -> None:
        """Begin to back out of a dead end."""
        self.attempts += 1
        self.dead_ends.append(place[:2] + DEAD_END_AHEAD * np.array([np.cos(place[2]), np.sin(place[2])]))
        self._back_left = self.config.back_up

    def search(
        self,
        place: np.ndarray,
        ground: Traversability,
        elevation: ElevationMap,
        planner: Planner,
        pan: float,
        mast_obeys: bool,
    ) -> Command | None:
        """Look to both sides, then back out, then turn.

        Args:
            place: (3,) x, y [m], yaw [rad] of the rover.
            ground: The judged ground.
            elevation: The map.
            planner: The planner.
            pan: Pan of the mast at the last image [rad].
            mast_obeys: Whether the mast obeys.

        Returns:
            The command; None after max_recoveries attempts that did not help.
        """
        if self._pans_to_look is None:
            side = min(np.deg2rad(self.config.look_pan_deg), self.spec.mount.pan_limit)
            self._pans_to_look = [a for a in (side, -side, 0.0) if abs(a - pan) > PAN_TOLERANCE]
        if not mast_obeys:
            self._pans_to_look = []
        if self._pans_to_look:
            target = self._pans_to_look[0]
            if abs(target - pan) <= PAN_TOLERANCE:  # the mast needed more than one step to get there
                self._pans_to_look.pop(0)
                return self.search(place, ground, elevation, planner, pan, mast_obeys)
            return Command(0.0, 0.0, target or None, "look")
        if self.attempts >= self.config.max_recoveries:
            return None
        self._pans_to_look = None
        self.start(place)
        planner.reset()
        command = self.back_up(place, ground, elevation, planner)
        if command is not None:
            return command
        turns = planner.free_turns(elevation, ground, place)
        if turns.size:
            # Towards the side with more room to turn; the new view may open a way.
            target = turns[np.abs(turns).argmax()]
            rate = float(np.clip(target / self.config.step_time, -self.spec.max_yaw_rate, self.spec.max_yaw_rate))
            return Command(0.0, rate, None, "recover")
        return Command(0.0, 0.0, None, "look")

    def back_up(
        self, place: np.ndarray, ground: Traversability, elevation: ElevationMap, planner: Planner
    ) -> Command | None:
        """Reverse along the driven track.

        Args:
            place: (3,) x, y [m], yaw [rad] of the rover now.
            ground: The judged ground.
            elevation: The map.
            planner: The planner.

        Returns:
            The command; None where the track ends or is closed, which ends the backing.
        """
        self._drop_reached(place)
        if self._back_left <= 0 or not self._track:
            self._back_left = 0.0
            return None
        offset = self._track[-1][:2] - place[:2]
        x = float(np.cos(place[2]) * offset[0] + np.sin(place[2]) * offset[1])
        y = float(-np.sin(place[2]) * offset[0] + np.cos(place[2]) * offset[1])
        # A circle through the track point, tangent to the heading (pure pursuit, backwards).
        curvature = 2 * y / max(x * x + y * y, 1e-6)
        if x > -TRACK_BEHIND:
            self._back_left = 0.0
            return None
        backwards = min(self.config.back_speed, self.spec.max_speed)
        speed, yaw_rate = steerable(-backwards, -curvature * backwards, self.spec)
        if not speed:  # the wheels of some rovers can only turn in place there
            self._back_left = 0.0
            return None
        spacing = self.config.planner.spacing
        poses = arc_poses(place, np.array(yaw_rate / speed), -np.arange(CHECKED_POSES) * spacing)[None]
        if planner.free_length(poses, elevation, ground)[0] < 2 * spacing:
            self._back_left = 0.0
            return None
        return Command(speed, yaw_rate, None, "recover")
