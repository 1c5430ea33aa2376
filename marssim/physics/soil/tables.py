"""What a wheel pulls and needs on each soil, as tables over load and slip. They are computed once in a process.

A wheel drives with the slip at which its drawbar pull balances what holds it back. Looking that up is fast enough for
each step of a simulation; finding the sinkage each time is not.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from marssim.physics.soil.soils import SOILS, Rock, SoilName
from marssim.physics.soil.wheel import sinkage_under_load, wheel_forces

LOADS = np.geomspace(0.01, 0.5, 12)  # of the tables, over the weight of the whole rover
STEPS = 48  # of the tables' slip, which is the square of a share: close together where the pull changes fast
SLIPS = (np.arange(STEPS + 1) / STEPS) ** 2
SIDESLIP = 0.15  # sideways speed over that of the rim at which `side` holds: across a slope of 10 deg, roughly


@dataclass(frozen=True, eq=False)
class WheelTable:
    """A wheel on one soil: L loads by S slips."""

    loads: np.ndarray
    """(L,) loads on the wheel [N]."""
    slips: np.ndarray
    """(S,) slips: shares of its way that the wheel loses, 0 to 1."""
    pull: np.ndarray
    """(L, S) drawbar pull [N]; negative where the soil resists more than the wheel thrusts."""
    torque: np.ndarray
    """(L, S) torque of the motor [N m]."""
    sinkage: np.ndarray
    """(L, S) sinkage of the wheel [m]."""
    side: np.ndarray
    """(L,) force against a sideways slide over the rise of the pull at a slip as large."""

    def at(self, load: np.ndarray) -> np.ndarray:
        """Return pull, torque and sinkage over slip, (3, N, S), at loads (N,) [N].

        Loads above those of the table are clipped. Below, all three vanish with the load.
        """
        place = np.interp(load, self.loads, np.arange(len(self.loads)))
        low = np.minimum(place.astype(int), len(self.loads) - 2)
        share = (place - low)[:, None]
        every = np.stack([self.pull, self.torque, self.sinkage])
        out = every[:, low] * (1 - share) + every[:, low + 1] * share
        return out * np.minimum(load / self.loads[0], 1)[:, None]

    def side_at(self, load: np.ndarray) -> np.ndarray:
        """Return `side` (N,) at loads (N,) [N], which are clipped to the table."""
        return np.interp(load, self.loads, self.side)

    def slip_on_slope(self, weight: float, slope: np.ndarray) -> np.ndarray:
        """Return the slip with which a wheel climbs, 0 to 1: 1 where it does not get up.

        Args:
            weight: Share of the rover's weight that the wheel bears on level ground [N].
            slope: (...) slope of the ground [rad], 0 or more.
        """
        slope = np.asarray(slope, dtype=float)
        pulls = np.maximum.accumulate(self.at(weight * np.cos(slope.ravel()))[0], axis=1)
        needed = weight * np.sin(slope.ravel())
        out = [np.interp(need, pull, self.slips, left=0.0, right=1.0) for need, pull in zip(needed, pulls)]
        return np.array(out).reshape(slope.shape)


@lru_cache(maxsize=32)
def wheel_table(soil: SoilName, radius: float, width: float, weight: float) -> WheelTable:
    """Compute the table of a wheel on a soil, or return it from memory.

    On rock, the pull is the friction coefficient times the load, built up over the slip as on soil; nothing sinks, and
    nothing resists.

    Args:
        soil: Name of the soil.
        radius: Radius of the wheel [m].
        width: Width of the wheel [m].
        weight: Weight of the whole rover [N]. The largest load of the table is half of it.
    """
    ground, loads = SOILS[soil], weight * LOADS
    load, slip = loads[:, None], SLIPS[None, :]
    if isinstance(ground, Rock):
        pull = ground.friction * load * (1 - np.exp(-slip / ground.creep))
        return WheelTable(loads, SLIPS, pull, radius * pull, np.zeros_like(pull), np.ones_like(loads))
    size = radius, width
    sinkage = sinkage_under_load(ground, *size, load, slip)
    forces = wheel_forces(ground, *size, sinkage, slip)
    sideways = wheel_forces(ground, *size, sinkage_under_load(ground, *size, loads, 0.0, SIDESLIP), 0.0, SIDESLIP)
    rise = [np.interp(SIDESLIP, SLIPS, pull - pull[0]) for pull in forces.pull]
    return WheelTable(loads, SLIPS, forces.pull, forces.torque, sinkage, sideways.side / rise)
