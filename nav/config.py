"""Every setting of the navigator, in one place."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from marssim.base.command.limits import check_range, check_whole
from marssim.base.rover_spec import ZHURONG, RoverSpec
from nav.ground.elevation import ElevationConfig
from nav.ground.traversability import TraversabilityConfig
from nav.path.planner_config import PlannerConfig


@dataclass(frozen=True)
class RiskLevel:
    """Relaxed rules for the case that every path is closed."""

    step: float
    """Rocks up to this height may be driven over [m]. Measured heights are wrong by centimetres, so it stays below
    RoverSpec.obstacle_height."""
    slope_deg: float
    """Slopes up to this angle may be driven over [deg]."""
    margin_share: float
    """Share of the margins beside obstacles that is kept."""

    def __post_init__(self) -> None:
        check_range(self, step=(0, 100), slope_deg=(0, 180), margin_share=(0, 1))


@dataclass(frozen=True)
class NavigatorConfig:
    """Settings of Navigator and of its parts."""

    elevation: ElevationConfig = field(default_factory=ElevationConfig)
    """Settings of the elevation map."""
    traversability: TraversabilityConfig = field(default_factory=TraversabilityConfig)
    """Settings of the judgement of the ground."""
    planner: PlannerConfig = field(default_factory=PlannerConfig)
    """Settings of the planner."""
    step_time: float = 2.0
    """Time for which the rover holds a command [s]."""
    goal_radius: float = 0.5
    """Distance to the goal, by odometry, at which the drive ends [m]: half of what a mission may ask for."""
    clear_radius: float = 2.5
    """Radius around the start within which unseen ground is assumed to be flat and free [m]."""
    least_points: int = 50
    """An image that shows fewer points of ground counts as showing nothing."""
    look_pan_deg: float = 40.0
    """Pan to either side when the mast looks for a way out [deg]."""
    pan_reach_deg: float = 75.0
    """Largest pan when the mast follows the path [deg]."""
    look_before_turn_deg: float = 30.0
    """The mast looks ahead of a turn in place of more than this angle [deg], unless seen_share is reached."""
    seen_share: float = 0.6
    """Share of the ground ahead after the turn that must have been measured to turn without a look."""
    back_up: float = 1.2
    """Distance that a recovery drives back [m]."""
    back_speed: float = 0.15
    """Speed at which it drives back [m/s]."""
    max_recoveries: int = 6
    """Recoveries without coming one metre nearer to the goal, after which the rover is stuck."""
    closed_steps: int = 15
    """Steps in a row with every path to the goal closed by known obstacles, after which there is no path."""
    risk_after: int = 5
    """Steps in a row with every path closed, after which the next risk level is accepted."""
    risk_after_recoveries: int = 2
    """Recoveries without success, after which the next risk level is accepted."""
    risk_levels: tuple[RiskLevel, ...] = (
        RiskLevel(0.23, 26.0, 0.5),
        RiskLevel(0.25, 27.0, 0.4),
        RiskLevel(0.275, 28.0, 0.3),
    )
    """The levels of risk, in the order in which they are accepted."""
    risk_steps: int = 25
    """Steps for which a risk level is accepted."""
    slip_steps: int = 2
    """Drive steps without motion that mean an unseen obstacle."""

    def __post_init__(self) -> None:
        parts = {"elevation": ElevationConfig, "traversability": TraversabilityConfig, "planner": PlannerConfig}
        for name, kind in parts.items():
            if not isinstance(getattr(self, name), kind):
                raise ValueError(f"{name} must be a {kind.__name__}, got {getattr(self, name)!r}")
        levels = self.risk_levels
        if not isinstance(levels, tuple) or not all(isinstance(level, RiskLevel) for level in levels):
            raise ValueError(f"risk_levels must be a tuple of RiskLevel, () for none, got {levels!r}")
        check_range(
            self, step_time=(1e-3, 1e4), goal_radius=(0, 1e4), clear_radius=(0, 1e4), look_pan_deg=(0, 180),
            pan_reach_deg=(0, 180), look_before_turn_deg=(0, 360), seen_share=(0, 1), back_up=(0, 1e4),
            back_speed=(1e-3, 1e3),
        )  # fmt: skip
        check_whole(
            self, least_points=0, max_recoveries=0, closed_steps=1, risk_after=1, risk_after_recoveries=0, risk_steps=0,
            slip_steps=1,
        )  # fmt: skip
        if not 4 * self.planner.coarse * self.elevation.cell <= (1 + 1e-9) * self.elevation.size:
            raise ValueError(
                f"planner.coarse must be at most a quarter of the map's cells, got {self.planner.coarse}, of "
                f"{self.elevation.cell:g} m in {self.elevation.size:g} m"
            )
        # A level that ends before the rover gives up would be accepted again and again.
        if self.risk_levels and self.risk_steps <= self.closed_steps:
            raise ValueError(
                f"risk_steps must be more than closed_steps, got {self.risk_steps} and {self.closed_steps}: "
                "the navigator would never give up"
            )

    @classmethod
    def of_rover(cls, spec: RoverSpec) -> NavigatorConfig:
        """Return the settings for a rover.

        The heights and angles that it may drive over, and the lengths that hide such heights, are those for Zhurong, in
        proportion to obstacle_height, max_slope, max_tilt and wheel_radius of the two. Lengths are two cells or more.
        """
        height = spec.obstacle_height / ZHURONG.obstacle_height
        slope, tilt = spec.max_slope / ZHURONG.max_slope, spec.max_tilt / ZHURONG.max_tilt
        wheel = spec.wheel_radius / ZHURONG.wheel_radius
        config = cls()
        shortest = 2 * config.elevation.cell
        ground, drops = config.traversability, config.elevation.drops
        return replace(
            config,
            elevation=replace(
                config.elevation,
                drops=replace(
                    drops, least_drop=height * drops.least_drop, least_gap=max(wheel * drops.least_gap, shortest)
                ),
            ),
            traversability=replace(
                ground,
                step_free=height * ground.step_free,
                step_blocked=height * ground.step_blocked,
                roughness_blocked=height * ground.roughness_blocked,
                hiding_width=max(height * ground.hiding_width, shortest),
                slope_free_deg=slope * ground.slope_free_deg,
                slope_blocked_deg=slope * ground.slope_blocked_deg,
            ),
            planner=replace(config.planner, tilt_limit_deg=tilt * config.planner.tilt_limit_deg),
            risk_levels=tuple(
                RiskLevel(height * level.step, slope * level.slope_deg, level.margin_share)
                for level in config.risk_levels
            ),
        )
