"""The risk that the navigator accepts for a time, in steps, when every known way is closed or recoveries fail."""

from __future__ import annotations

from dataclasses import replace

from nav.config import NavigatorConfig, RiskLevel
from nav.ground.traversability import TraversabilityConfig


class RiskTaking:
    """The level of risk that the navigator accepts now.

    Attributes:
        closed: How many steps in a row known obstacles have closed every path to the goal.
    """

    def __init__(self, config: NavigatorConfig) -> None:
        self.config = config
        self._steps_left = 0
        self.reset()

    def reset(self) -> None:
        """Accept no extra risk, as at the start and after a new goal."""
        self.closed = 0
        self._level = 0  # how many of config.risk_levels are accepted

    def update(self, closed: bool, hemmed_in: bool) -> None:
        """Count one step.

        Args:
            closed: Whether known obstacles close every path to the goal.
            hemmed_in: Whether the rover stands too near to an obstacle.
        """
        self.closed = self.closed + 1 if closed else 0
        self._steps_left -= 1
        if self._steps_left <= 0 and not hemmed_in:
            self._level = 0  # only after the rover has left the place that the risk let it enter
        if self.closed >= self.config.risk_after:
            self.raise_level()

    def raise_level(self) -> None:
        """Accept the next level of config.risk_levels, if one is left."""
        if self._level < len(self.config.risk_levels):
            self._level, self._steps_left, self.closed = self._level + 1, self.config.risk_steps, 0

    def came_nearer(self) -> None:
        """Note that the rover has come nearer to its goal: at the last level, closed steps count from zero again."""
        if self._level == len(self.config.risk_levels):
            self.closed = 0

    @property
    def level(self) -> int:
        """How many of config.risk_levels are accepted now."""
        return self._level

    @property
    def given_up(self) -> bool:
        """Whether every path has been closed for too long."""
        return self.closed >= self.config.closed_steps

    @property
    def margin_share(self) -> float:
        """Share of the margins beside obstacles that is kept."""
        return self._current.margin_share if self._current else 1.0

    @property
    def rules(self) -> TraversabilityConfig:
        """The rules of traversability at the present level."""
        rules, level = self.config.traversability, self._current
        if level is None:
            return rules
        return replace(
            rules,
            step_blocked=max(level.step, rules.step_blocked),
            slope_blocked_deg=max(level.slope_deg, rules.slope_blocked_deg),
            margin=rules.margin * level.margin_share,
        )

    @property
    def _current(self) -> RiskLevel | None:
        return self.config.risk_levels[self._level - 1] if self._level else None
