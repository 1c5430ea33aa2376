"""What a drive over soil cost: lost and sideways way, sinkage, energy."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from marssim.physics.soil.traction import Balance

EFFICIENCY = 0.4  # of motors and gears together; chosen
DRIVE_FRICTION = 1.0  # [N m] torque of a wheel that turns freely; chosen
LEAST_WAY = 5e-3  # [m] of the rims, from which on slip is a share of it


@dataclass
class Slippage:
    """Sums over a drive."""

    turned: float = 0.0
    """Way of the wheels' rims, mean of the wheels [m]."""
    made: float = 0.0
    """The part of it that the wheels' hubs made [m]."""
    sideways: float = 0.0
    """Way that the rover slid to its left [m]."""
    energy: float = 0.0
    """Electric energy of the wheels' motors [J]; braking gives none back."""
    seconds: float = 0.0
    """Time with turning wheels [s]."""
    rolled: np.ndarray = field(default_factory=lambda: np.zeros(2))
    """(2,) way by which the rims would have moved the rover, with its true headings, world frame [m]."""
    sunk: float = 0.0
    """Sum of the mean sinkage of the wheels over time [m s]."""

    @property
    def slip(self) -> float:
        """Share of the rims' way that the rover did not make, below 0 if it slid further.

        0 if the rims made less than LEAST_WAY. Braking wheels still turn by a millimetre, and a ratio of such small
        distances is no measure of grip.
        """
        return 1 - self.made / self.turned if self.turned >= LEAST_WAY else 0.0

    @property
    def sinkage(self) -> float:
        """Mean sinkage of the wheels while they turned [m]."""
        return self.sunk / self.seconds if self.seconds > 0 else 0.0

    def add(self, balance: Balance, radius: float, seconds: float, rolled: np.ndarray) -> None:
        """Add a time in which the balance of the wheels held.

        Args:
            balance: The balance.
            radius: Radius of the wheels [m].
            seconds: The time [s].
            rolled: (2,) way by which the rims would have moved the rover, world frame [m].
        """
        speeds = np.hypot(*balance.rims.T)
        if not speeds.any():
            return
        along = (balance.hub_velocities * balance.rims).sum(axis=1) / np.maximum(speeds, 1e-12)
        torque = np.maximum(balance.torque + DRIVE_FRICTION, 0)
        self.turned += float(speeds.mean()) * seconds
        self.made += float(along.mean()) * seconds
        self.sideways += float(balance.motion[1] - balance.rims[:, 1].mean()) * seconds
        self.energy += float((torque * speeds).sum()) / radius / EFFICIENCY * seconds
        self.seconds += seconds
        self.sunk += float(balance.sinkage.mean()) * seconds
        self.rolled = self.rolled + rolled
