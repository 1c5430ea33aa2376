"""What the navigator dares where every way it knows of is closed: a little more, step by step, and for a while."""

from __future__ import annotations

from dataclasses import replace

from nav.config import Boldness, NavigatorConfig
from nav.ground.traversability import TraversabilityConfig


class Daring:
    """Counts for how long every way to the goal has been closed (`closed`, in steps), and how much is dared."""

    def __init__(self, config: NavigatorConfig) -> None:
        self.config = config
        self._left = 0
        self.forget()

    def forget(self) -> None:
        """A new goal: dare nothing yet."""
        self.closed = 0
        self._level = 0  # how many of config.bold are dared

    def update(self, closed: bool, hemmed_in: bool) -> None:
        """A step went by. closed: whether known obstacles close every way to the goal; hemmed_in: whether the rover
        stands too near to an obstacle."""
        self.closed = self.closed + 1 if closed else 0
        self._left -= 1
        if self._left <= 0 and not hemmed_in:
            self._level = 0  # not before the rover has left what it dared to enter
        if self.closed >= self.config.bold_after:
            self.more()

    def more(self) -> None:
        """Go one step on in config.bold, if there is one left."""
        if self._level < len(self.config.bold):
            self._level, self._left, self.closed = self._level + 1, self.config.bold_steps, 0

    @property
    def given_up(self) -> bool:
        """Whether every way has been closed for too long."""
        return self.closed >= self.config.closed_steps

    @property
    def margin_share(self) -> float:
        """Of the margins beside obstacles, what is kept."""
        return self._dared.margin_share if self._dared else 1.0

    @property
    def rules(self) -> TraversabilityConfig:
        """Traversability's, with what is dared."""
        rules, dared = self.config.traversability, self._dared
        if dared is None:
            return rules
        return replace(
            rules,
            step_blocked=max(dared.step, rules.step_blocked),
            slope_blocked_deg=max(dared.slope_deg, rules.slope_blocked_deg),
            margin=rules.margin * dared.margin_share,
        )

    @property
    def _dared(self) -> Boldness | None:
        return self.config.bold[self._level - 1] if self._level else None
