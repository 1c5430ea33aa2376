"""Conditions whose strength is a range, as {"optical_depth": (1, 3)}, from which each scene draws its own."""

from __future__ import annotations

from typing import Any

import numpy as np

from envs.suites.conditions import OF_COURSE, OF_EYES, Values, condition_values
from envs.world.eyes import EYES_LIMITS
from marssim.scene.look import LOOK_LIMITS

# what a range makes sense for; the others are whole numbers, names, or true or false
DRAWABLE = (
    {*OF_COURSE, *OF_EYES, *LOOK_LIMITS}
    - {"into_sun", "ditch", "scene_seed"}
    - {name for name, (_, _, unit) in EYES_LIMITS.items() if unit == " px"}
)


def range_ends(name: str, value: Any) -> tuple[float, float]:
    """Return the two ends of a range.

    Args:
        name: What messages call it.
        value: A tuple or list.

    Raises:
        ValueError: It does not have two ends.
    """
    if len(value) != 2 or None in value:
        raise ValueError(f"{name} must be a number or the two ends of a range, got {value!r}")
    low, high = value
    return low, high


class ConditionRanges:
    """A condition, some of whose values may be ranges.

    Attributes:
        condition: The condition as it was given.
        ends: The condition at the lower and at the upper ends of its ranges.
    """

    def __init__(self, condition: str | Values) -> None:
        """Check the ranges.

        Raises:
            ValueError: There is no condition or no value of that name, or a range does not have two ends, or is of a
                value that cannot be drawn. One line that names it.
        """
        self.condition = condition
        self._ranges: dict[str, tuple[float, float]] = {}
        for name, value in condition_values(condition).items():
            if isinstance(value, tuple | list):
                if name not in DRAWABLE:
                    raise ValueError(f"{name} must be one value in a condition, not a range, got {value!r}")
                self._ranges[name] = range_ends(name, value)
        self.ends = tuple(self._with({name: each[end] for name, each in self._ranges.items()}) for end in (0, 1))

    @property
    def fixed(self) -> bool:
        """Whether nothing is to be drawn."""
        return not self._ranges

    def check_order(self) -> None:
        """Raise ValueError that names a range whose upper end comes first. The ends must have been checked before."""
        for name, (low, high) in self._ranges.items():
            if low > high:
                raise ValueError(f"{name} must have the lower end of its range first, got {(low, high)!r}")

    def draw(self, rng: np.random.Generator) -> str | Values:
        """Return the condition with values drawn evenly from its ranges. Without a range, rng is not used."""
        return self._with({name: float(rng.uniform(*ends)) for name, ends in self._ranges.items()})

    def _with(self, numbers: dict[str, float]) -> str | Values:
        if not numbers or isinstance(self.condition, str):
            return self.condition
        return {**self.condition, **numbers}
