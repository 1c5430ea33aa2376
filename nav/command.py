"""The command that the navigator returns."""

from __future__ import annotations

from dataclasses import dataclass

STAND_STILL = ("arrived", "stuck", "no_path")  # statuses that end the drive


@dataclass(frozen=True)
class Command:
    """The motion of the rover in the next step."""

    speed: float
    """Forward speed [m/s], negative backwards."""
    yaw_rate: float
    """Yaw rate [rad/s], positive to the left."""
    pan: float | None
    """Pan of the mast for the next image [rad], positive to the left; None for straight ahead."""
    status: str
    """What the rover does: "drive"; "turn" (in place); "look" (stand, and look where `pan` points); "recover" (back out
    of a dead end); "blind" (stand, as there was no depth); "arrived"; "stuck" (recoveries did not help); or "no_path"
    (the same, and known obstacles close every path). The last three end the drive; the rover stands still."""

    @property
    def over(self) -> bool:
        """Whether the drive has ended, for whatever reason."""
        return self.status in STAND_STILL
