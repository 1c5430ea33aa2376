"""What the navigator answers."""

from __future__ import annotations

from dataclasses import dataclass

STAND_STILL = ("arrived", "stuck", "no_path")  # after these the drive is over


@dataclass(frozen=True)
class Command:
    """What the rover shall do in the next step.

    speed [m/s], negative backwards; yaw_rate [rad/s], positive to the left; pan [rad] of the mast for the next image,
    None for straight ahead. status: "drive", "turn" (in place), "look" (stand, and look where pan says), "recover"
    (backing out of a dead end), "blind" (no depth: standing), "arrived", "stuck" (recoveries did not help) or
    "no_path" (the same, and obstacles are known to close every way). The last three stand still.
    """

    speed: float
    yaw_rate: float
    pan: float | None
    status: str

    @property
    def over(self) -> bool:
        """Whether the drive has come to its end, whichever."""
        return self.status in STAND_STILL
