"""The settings of the planner."""

from __future__ import annotations

from dataclasses import dataclass

from marssim.base.command.limits import check_least, check_range, check_whole


@dataclass(frozen=True)
class PlannerConfig:
    """Candidate motions and the costs that compare them, in metres of easy ground."""

    arcs: int = 31
    """Number of curvatures that are tried."""
    arc_length: float = 4.0
    """Length of an arc [m]."""
    max_turn_deg: float = 100.0
    """Turn at which an arc ends [deg]."""
    turns: int = 24
    """Number of headings that are tried by turning in place and then driving straight."""
    spacing: float = 0.2
    """Distance between the poses that are checked on a motion [m]."""
    commit: float = 0.8
    """Least free length of a motion [m]: one drive step and room to stop."""
    lookahead: float = 2.5
    """Distance at which motions are compared [m], or at their end if that comes first."""
    margin: float = 0.08
    """Least distance from the covered footprint (footprint_discs) to an obstacle [m]."""
    dark_margin: float = 0.0
    """Least distance from the covered footprint to unseen ground [m]."""
    tilt_limit_deg: float = 25.0
    """Largest tilt of the chassis on its wheels [deg]: RoverSpec.max_tilt less a margin."""
    belly_margin: float = 0.05
    """Least distance from the chassis to the ground below it [m]."""
    turn_cost: float = 0.5
    """Cost of a radian turned in place [m]."""
    turn_start_cost: float = 0.5
    """Cost of stopping in order to turn [m]; not charged again while a turn continues."""
    turn_back_cost: float = 1.0
    """Cost of turning back at once [m]; it doubles each further time until the rover drives."""
    turn_dark_cost: float = 4.0
    """Cost of turning in place over unseen ground [m], so that the rover does it only where nothing else leads on."""
    bend_cost: float = 0.15
    """Cost of a radian turned while driving [m]."""
    change_cost: float = 0.3
    """Cost of changing the previous curvature by 1/m [m]."""
    heading_cost: float = 0.6
    """Cost of a radian between the heading at the motion's end and the way onwards [m]."""
    coarse: int = 2
    """Map cells along one cell of the distance field."""
    inflated_cost: float = 30.0
    """Extra cost of a metre too near to an obstacle [m]: high enough to lead out of such a place, and never through
    one."""

    def __post_init__(self) -> None:
        check_whole(self, arcs=1, turns=1, coarse=1)
        check_range(
            self, arc_length=(0.1, 1000), max_turn_deg=(1, 360), spacing=(0.01, 100), commit=(0.01, 1000),
            lookahead=(0.1, 1000), tilt_limit_deg=(0, 180),
        )  # fmt: skip
        check_least(
            self, margin=0, dark_margin=0, belly_margin=0, turn_cost=0, turn_start_cost=0, turn_back_cost=0,
            turn_dark_cost=0, bend_cost=0, change_cost=0, heading_cost=0, inflated_cost=0,
        )  # fmt: skip
        if (nearest := min(self.lookahead, self.arc_length)) < self.commit:
            raise ValueError(
                f"commit must be at most lookahead and arc_length, or no motion is long enough, got {self.commit} "
                f"and {nearest}"
            )
