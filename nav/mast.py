"""Where the mast looks: along the path, and there first where a turn in place leads into what was not seen."""

from __future__ import annotations

import numpy as np

from marssim.base.rover_spec import RoverSpec
from nav.command import Command
from nav.config import NavigatorConfig
from nav.ground.elevation import ElevationMap

LOOKED = np.deg2rad(10.0)  # the mast is where it was asked to be within this
AHEAD = np.deg2rad(15.0)  # smaller bearings are within the view straight ahead


class Mast:
    """Chooses pans [rad], positive to the left. works: False once the mast did not obey."""

    def __init__(self, spec: RoverSpec, config: NavigatorConfig) -> None:
        self.spec, self.config = spec, config
        self.works = True
        self._looked = False  # before the turn that goes on
        self._last = 0.0

    def follow(self, pan: float, wish: float | None) -> None:
        """Note where the mast is. wish: what was asked of it in the step before, None for straight ahead."""
        if wish is not None and abs(wish - pan) > LOOKED and abs(wish - pan) > abs(wish - self._last) - LOOKED:
            self.works = False  # neither there nor on its way
        self._last = pan

    def towards(self, bearing: float) -> float | None:
        """The pan for a bearing [rad]; None near straight ahead, or where the mast does not obey."""
        if not self.works or abs(bearing) < AHEAD:
            return None
        reach = min(np.deg2rad(self.config.pan_reach_deg), self.spec.mount.pan_limit)
        return float(np.clip(bearing, -reach, reach))

    def turn_is_over(self) -> None:
        """The rover drives on: the next turn is looked into anew."""
        self._looked = False

    def must_look(self, turn: float, here: np.ndarray, pan: float, last: Command, elevation: ElevationMap) -> bool:
        """Whether it shall look where a turn in place leads before the turn is begun.

        Once a turn; and on, while the mast is still on its way there. turn [rad]; here: (3,) x, y, yaw; pan [rad] at
        the last image; last: the command before it.
        """
        wish = self.towards(turn)
        if wish is None or abs(turn) < np.deg2rad(self.config.look_before_turn_deg):
            return False
        on_the_way = last.status == "look" and last.pan is not None
        if self._looked and not (on_the_way and abs(wish - pan) > LOOKED):
            return False
        self._looked = True
        return self._seen(here, turn, elevation) < self.config.seen_share

    def _seen(self, here: np.ndarray, turn: float, elevation: ElevationMap) -> float:
        """Share of the way ahead after a turn that was measured."""
        heading, spec = here[2] + turn, self.spec
        ahead = np.arange(spec.length / 2, spec.length / 2 + self.config.planner.lookahead, 0.2)
        across = np.linspace(-0.5, 0.5, 7) * spec.width
        c, s = np.cos(heading), np.sin(heading)
        u, v = np.meshgrid(ahead, across)
        cell = elevation.cell_of(np.stack([here[0] + c * u - s * v, here[1] + s * u + c * v], axis=-1))
        inside = ((cell >= 0) & (cell < elevation.n)).all(axis=-1)
        cell = np.clip(cell, 0, elevation.n - 1)
        return float((elevation.measured[cell[..., 1], cell[..., 0]] & inside).mean())
