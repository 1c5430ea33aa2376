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

LOADS = np.geomspace(10.0, 400.0, 12)  # [N] the wheels of a rover of 240 kg bear 150 N on level ground
STEPS = 48  # of the tables' slip, which is the square of a share: close together where the pull changes fast
SLIPS = (np.arange(STEPS + 1) / STEPS) ** 2


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

    def at(self, load: np.ndarray) -> np.ndarray:
        """Return pull, torque and sinkage over slip, (3, N, S), at loads (N,) [N], which are clipped to the table."""
        place = np.interp(load, self.loads, np.arange(len(self.loads)))
        low = np.minimum(place.astype(int), len(self.loads) - 2)
        share = (place - low)[:, None]
        every = np.stack([self.pull, self.torque, self.sinkage])
        return every[:, low] * (1 - share) + every[:, low + 1] * share

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
def wheel_table(soil: SoilName, radius: float, width: float) -> WheelTable:
    """Compute the table of a wheel on a soil, or return it from memory.

    On rock, the pull is the friction coefficient times the load, built up over the slip as on soil; nothing sinks, and
    nothing resists.

    Args:
        soil: Name of the soil.
        radius: Radius of the wheel [m].
        width: Width of the wheel [m].
    """
    ground, load, slip = SOILS[soil], LOADS[:, None], SLIPS[None, :]
    if isinstance(ground, Rock):
        pull = ground.friction * load * (1 - np.exp(-slip / ground.creep))
        return WheelTable(LOADS, SLIPS, pull, radius * pull, np.zeros_like(pull))
    sinkage = sinkage_under_load(ground, radius, width, load, slip)
    forces = wheel_forces(ground, radius, width, sinkage, slip)
    return WheelTable(LOADS, SLIPS, forces.pull, forces.torque, sinkage)
