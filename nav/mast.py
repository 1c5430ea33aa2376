"""The direction in which the mast looks: along the path, and into a turn in place before the rover makes it."""

from __future__ import annotations

import numpy as np

from marssim.base.rover_spec import RoverSpec
from nav.command import Command
from nav.config import NavigatorConfig
from nav.ground.elevation import ElevationMap

PAN_TOLERANCE = np.deg2rad(10.0)  # [rad] within which the mast has reached a pan
PAN_MOVED = np.deg2rad(1.0)  # [rad] by which a mast that moves comes nearer to a pan in a step
AHEAD_BEARING = np.deg2rad(15.0)  # [rad] below which a bearing lies within the view straight ahead


class Mast:
    """Chooses the pan of the mast [rad], positive to the left.

    Attributes:
        obeys: False once the mast did not move as commanded.
    """

    def __init__(self, spec: RoverSpec, config: NavigatorConfig) -> None:
        self.spec, self.config = spec, config
        self.obeys = True
        self._looked = False  # whether it has looked into the present turn
        self._last_pan = 0.0

    def follow(self, pan: float, commanded: float | None) -> None:
        """Note the pan that the mast has reached.

        Args:
            pan: The pan now [rad].
            commanded: The pan that the step before commanded [rad]; None for straight ahead.
        """
        if commanded is not None:
            missing = abs(commanded - pan)
            if missing > PAN_TOLERANCE and missing > abs(commanded - self._last_pan) - PAN_MOVED:
                self.obeys = False  # it is neither at the pan nor moving towards it
        self._last_pan = pan

    def towards(self, bearing: float) -> float | None:
        """Return the pan for a bearing [rad]; None near straight ahead, or if the mast does not obey."""
        if not self.obeys or abs(bearing) < AHEAD_BEARING:
            return None
        reach = min(np.deg2rad(self.config.pan_reach_deg), self.spec.mount.pan_limit)
        return float(np.clip(bearing, -reach, reach))

    def turn_is_over(self) -> None:
        """Note that the rover drives again, so that the mast looks into the next turn too."""
        self._looked = False

    def must_look(self, turn: float, place: np.ndarray, pan: float, last: Command, elevation: ElevationMap) -> bool:
        """Return whether the mast shall look into a turn in place before the rover begins it.

        It looks once for each turn, and goes on looking while the mast is still moving there.

        Args:
            turn: The turn [rad], positive to the left.
            place: (3,) x, y [m], yaw [rad] of the rover.
            pan: Pan of the mast at the last image [rad].
            last: The command before it.
            elevation: The map.
        """
        target = self.towards(turn)
        if target is None or abs(turn) < np.deg2rad(self.config.look_before_turn_deg):
            return False
        on_the_way = last.status == "look" and last.pan is not None
        if self._looked and not (on_the_way and abs(target - pan) > PAN_TOLERANCE):
            return False
        self._looked = True
        return self._measured_share(place, turn, elevation) < self.config.seen_share

    def _measured_share(self, place: np.ndarray, turn: float, elevation: ElevationMap) -> float:
        """Return the share of the ground ahead after a turn that has been measured."""
        heading, spec = place[2] + turn, self.spec
        ahead = np.arange(spec.length / 2, spec.length / 2 + self.config.planner.lookahead, 0.2)
        across = np.linspace(-0.5, 0.5, 7) * spec.width
        c, s = np.cos(heading), np.sin(heading)
        u, v = np.meshgrid(ahead, across)
        cell = elevation.cell_of(np.stack([place[0] + c * u - s * v, place[1] + s * u + c * v], axis=-1))
        inside = ((cell >= 0) & (cell < elevation.n)).all(axis=-1)
        cell = np.clip(cell, 0, elevation.n - 1)
        return float((elevation.measured[cell[..., 1], cell[..., 0]] & inside).mean())
