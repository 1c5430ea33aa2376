"""What the rover does when there is no way on: it looks to both sides, backs out along its track, turns, or gives up.

Dead ends and what it bumped into are remembered, so that the next plan leads elsewhere.
"""

from __future__ import annotations

import numpy as np

from marssim.base.rover_spec import RoverSpec
from nav.command import Command
from nav.config import NavigatorConfig
from nav.controller import steerable
from nav.ground.elevation import ElevationMap
from nav.ground.traversability import Traversability
from nav.mast import LOOKED
from nav.path.footprint import arc_poses
from nav.path.planner import Planner

TRACK_STEP = 0.2  # [m] between two points of the driven track
BEFORE = 0.15  # [m] before the rover's front stands what it bumped into
INTO = 0.5  # [m] ahead of the rover's middle is where a dead end is noted
PASSED = 0.5  # [m] from the rover, points of the track have been driven back to
BEHIND = 0.1  # [m] behind the rover's middle a point of the track must lie to be driven back to
MOVED = 0.02  # [m] in a step, less than which it does not back out
CHECKED = 4  # poses of a step back that are checked


class Recovery:
    """The driven track, and the ways back.

    bumps, dead_ends: world positions (2,) [m]. attempts: recoveries begun since the goal last came nearer.
    """

    def __init__(self, spec: RoverSpec, config: NavigatorConfig) -> None:
        self.spec, self.config = spec, config
        self.bumps: list[np.ndarray] = []
        self.dead_ends: list[np.ndarray] = []
        self.attempts = 0
        self._track: list[np.ndarray] = []
        self._looks: list[float] | None = None
        self._back_left = 0.0

    @property
    def backing(self) -> bool:
        """Whether the rover is on its way back."""
        return self._back_left > 0

    @property
    def looking(self) -> bool:
        """Whether the mast is on its way round, at a dead end."""
        return self._looks is not None

    def follow(self, here: np.ndarray) -> None:
        """Note where the rover is. here: (3,) x, y, yaw."""
        if not self._track or np.hypot(*(here - self._track[-1])[:2]) > TRACK_STEP:
            self._track.append(here)

    def found_a_way(self) -> None:
        """There is a way on: the next dead end is looked round anew."""
        self._looks = None

    def bump(self, here: np.ndarray) -> None:
        """The rover drives and does not move: something unseen stands before it."""
        ahead = self.spec.length / 2 + BEFORE
        self.bumps.append(here[:2] + ahead * np.array([np.cos(here[2]), np.sin(here[2])]))
        self.start(here)

    def start(self, here: np.ndarray) -> None:
        """Begin to back out of a dead end."""
        self.attempts += 1
        self.dead_ends.append(here[:2] + INTO * np.array([np.cos(here[2]), np.sin(here[2])]))
        self._back_left = self.config.back_up

    def search(
        self,
        here: np.ndarray,
        ground: Traversability,
        elevation: ElevationMap,
        planner: Planner,
        pan: float,
        mast: bool,
    ) -> Command | None:
        """Look to both sides, then back out, then turn; None when max_recoveries did not help.

        pan [rad] of the mast at the last image; mast: whether it obeys.
        """
        if self._looks is None:
            side = np.deg2rad(self.config.look_pan_deg)
            self._looks = [a for a in (side, -side, 0.0) if abs(a - pan) > LOOKED]
        if not mast:
            self._looks = []
        if self._looks:
            wish = self._looks[0]
            if abs(wish - pan) <= LOOKED:  # it took the mast more than one step to come there
                self._looks.pop(0)
                return self.search(here, ground, elevation, planner, pan, mast)
            return Command(0.0, 0.0, wish or None, "look")
        if self.attempts >= self.config.max_recoveries:
            return None
        self._looks = None
        self.start(here)
        planner.reset()
        command = self.back_up(here, here, Command(0.0, 0.0, None, "look"), ground, elevation, planner)
        if command is not None:
            return command
        turns = planner.free_turns(elevation, ground, here)
        if turns.size:
            # Towards the side with more room to turn; the new view may open a way.
            target = turns[np.abs(turns).argmax()]
            rate = float(np.clip(target / self.config.step_time, -self.spec.max_yaw_rate, self.spec.max_yaw_rate))
            return Command(0.0, rate, None, "recover")
        return Command(0.0, 0.0, None, "look")

    def back_up(
        self,
        here: np.ndarray,
        before: np.ndarray,
        last: Command,
        ground: Traversability,
        elevation: ElevationMap,
        planner: Planner,
    ) -> Command | None:
        """Reverse along the driven track. None where it ends or is closed, which ends the backing.

        here, before: (3,) x, y, yaw now and at the last step; last: the command between them.
        """
        moved = float(np.hypot(*(here - before)[:2]))
        if last.status == "recover" and last.speed < 0:
            self._back_left -= moved
            if moved < MOVED:
                self._back_left = 0.0
        while len(self._track) > 1 and np.hypot(*(here - self._track[-1])[:2]) < PASSED:
            self._track.pop()
        if self._back_left <= 0 or not self._track:
            self._back_left = 0.0
            return None
        away = self._track[-1][:2] - here[:2]
        x = float(np.cos(here[2]) * away[0] + np.sin(here[2]) * away[1])
        y = float(-np.sin(here[2]) * away[0] + np.cos(here[2]) * away[1])
        # A circle through the track point, tangent to the heading (pure pursuit, backwards).
        curvature = 2 * y / max(x * x + y * y, 1e-6)
        if x > -BEHIND:
            self._back_left = 0.0
            return None
        speed, yaw_rate = steerable(-self.config.back_speed, -curvature * self.config.back_speed, self.spec)
        spacing = self.config.planner.spacing
        poses = arc_poses(here, np.array(yaw_rate / speed), -np.arange(CHECKED) * spacing)[None]
        if planner.free_length(poses, elevation, ground)[0] < 2 * spacing:
            self._back_left = 0.0
            return None
        return Command(speed, yaw_rate, None, "recover")
