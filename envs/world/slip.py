"""Wheels that slip in an episode: on which soil, what the odometry notices of it, and what it costs."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Real

import numpy as np

from envs.world.vehicle import Vehicle
from marssim.physics.soil.slippage import Slippage
from marssim.physics.soil.soil_map import GROUND_NAMES, GroundName


@dataclass(frozen=True)
class SlipConfig:
    """How the wheels slip, and how well the rover knows."""

    ground: GroundName = "scene"
    """Soil under the wheels: scene (the sand, crust and bedrock that the scene shows), or one of these everywhere."""
    measured: float = 0.0
    """Share of the slip that the odometry measures: 0 counts the wheels' turns, 1 sees the true way, as visual odometry
    does at best."""

    def __post_init__(self) -> None:
        if self.ground not in GROUND_NAMES:
            raise ValueError(f"slip {self.ground!r} is unknown; choose from {', '.join(GROUND_NAMES)}")
        share = self.measured
        if isinstance(share, bool) or not isinstance(share, Real) or not 0 <= float(share) <= 1:
            raise ValueError(f"the measured share of the slip must lie in [0, 1], got {share!r}")


def checked_slip(slip: SlipConfig | GroundName | None) -> SlipConfig | None:
    """Return the settings of the slip, also for a ground's name; None for wheels that do not slip.

    Raises:
        ValueError: If there is no such ground.
    """
    return slip if slip is None or isinstance(slip, SlipConfig) else SlipConfig(slip)


class SlipGauge:
    """Follows the slip of a vehicle through an episode."""

    def __init__(self, config: SlipConfig | None, vehicle: Vehicle, reported: bool) -> None:
        """Begin with the vehicle at rest.

        Args:
            config: None for wheels that do not slip.
            vehicle: The vehicle.
            reported: Whether `info` has the values, which are 0 for wheels that do not slip.
        """
        self._config, self._reported = config, reported
        self._place = vehicle.state().position[:2].copy()
        self._last = Slippage()
        self._excess = np.zeros(2)
        self._energy = self._seconds = 0.0

    def update(self, vehicle: Vehicle) -> np.ndarray:
        """Take in the last drive.

        Args:
            vehicle: The vehicle after it.

        Returns:
            (2,) way that the odometry counts and the rover did not make, world frame [m].
        """
        slippage = vehicle.slippage()
        if self._config is None or slippage is None:
            return np.zeros(2)
        place = vehicle.state().position[:2].copy()
        lost = slippage.rolled - (place - self._place)
        self._place, self._last = place, slippage
        self._energy += slippage.energy
        self._seconds += slippage.seconds
        self._excess = (1 - self._config.measured) * lost
        return self._excess

    def excess_speed(self, yaw: float, seconds: float) -> float:
        """Return the speed ahead that the odometry counts and the rover did not have in the last drive [m/s].

        Args:
            yaw: Heading of the rover [rad].
            seconds: Time of the drive [s].
        """
        return float(self._excess @ [np.cos(yaw), np.sin(yaw)]) / seconds

    def info(self) -> dict[str, float]:
        """Return what MarsNavEnv's info says of the slip; nothing where it is not reported."""
        if not self._reported:
            return {}
        return {
            "slip": self._last.slip, "sideways": self._last.sideways, "sinkage": self._last.sinkage,
            "energy": self._energy, "drive_seconds": self._seconds,
        }  # fmt: skip
