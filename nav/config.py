"""Everything of the navigator that can be tuned, in one place."""

from __future__ import annotations

from dataclasses import dataclass, field

from nav.ground.elevation import ElevationConfig
from nav.ground.traversability import TraversabilityConfig
from nav.path.planner import PlannerConfig


@dataclass(frozen=True)
class Boldness:
    """What is dared where every way is closed: rocks up to step [m] and slopes up to slope_deg are driven over, and
    the margins beside obstacles shrink to a share. Heights err by centimetres, so step stays below
    RoverSpec.obstacle_height."""

    step: float
    slope_deg: float
    margin_share: float


@dataclass(frozen=True)
class NavigatorConfig:
    """Settings of Navigator and of what it is made of."""

    elevation: ElevationConfig = field(default_factory=ElevationConfig)
    traversability: TraversabilityConfig = field(default_factory=TraversabilityConfig)
    planner: PlannerConfig = field(default_factory=PlannerConfig)
    step_time: float = 2.0  # a command is held this long [s]
    goal_radius: float = 0.5  # arrived within [m], of what the odometry says: half of what a mission may ask for
    clear_radius: float = 2.5  # round the start the ground is taken for clear [m]
    least_points: int = 50  # an image that shows fewer points of ground shows nothing
    look_pan_deg: float = 40.0  # the mast looks this far to either side for a way out
    pan_reach_deg: float = 75.0  # and at most this far when it follows the path
    look_before_turn_deg: float = 30.0  # before a turn in place of more than this the mast looks there first ...
    seen_share: float = 0.6  # ... unless this share of the way after the turn was seen
    back_up: float = 1.2  # recovery drives back this far [m]
    back_speed: float = 0.15  # at this speed [m/s]
    max_recoveries: int = 6  # without coming a metre nearer to the goal; then stuck
    closed_steps: int = 15  # in a row with every way to the goal closed by known obstacles; then no path ...
    bold_after: int = 5  # ... but first, after so many, the next of these is dared ...
    bold_after_recoveries: int = 2  # ... and likewise where so many recoveries led nowhere ...
    bold: tuple[Boldness, ...] = (Boldness(0.23, 26.0, 0.5), Boldness(0.25, 27.0, 0.4), Boldness(0.275, 28.0, 0.3))
    bold_steps: int = 25  # ... for so many steps
    slip_steps: int = 2  # drive steps without motion that mean an unseen obstacle

    def __post_init__(self) -> None:
        if self.bold and self.bold_steps <= self.closed_steps:  # daring would lapse and begin anew, again and again
            raise ValueError(
                f"bold_steps must be more than closed_steps, got {self.bold_steps} and {self.closed_steps}: "
                "the navigator would never give up"
            )
