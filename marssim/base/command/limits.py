"""Check the numbers of a command's config: those that are too small, and those that no work could be done with."""

from __future__ import annotations

import math
from dataclasses import Field
from numbers import Integral, Real
from typing import cast

LARGEST = 1e12  # magnitude of a number of any flag: larger ones overflow somewhere
LARGEST_INTEGER = (1 << 64) - 1  # magnitude of an integer, as of seeds


def check_least(config: object, **least: float) -> None:
    """Check fields of a config against their least values. None passes where the field may be None.

    Args:
        config: A dataclass.
        least: Least value of each field, by the field's name.

    Raises:
        ValueError: A value is smaller, or no number. The message begins with the field's name, of which a command makes
            the flag.
    """
    for name, bound in least.items():
        value = _number(config, name)
        if value is not None and not value >= bound:
            raise ValueError(f"{name} must be at least {bound:g}, got {value}")


def check_whole(config: object, **least: int) -> None:
    """Check that fields of a config are whole numbers, and not smaller than their least values.

    Args:
        config: A dataclass.
        least: Least value of each field, by the field's name.

    Raises:
        ValueError: A value is of another type, such as 2.0, or smaller. The message begins with the field's name.
    """
    for name, bound in least.items():
        value = getattr(config, name)
        if isinstance(value, bool) or not isinstance(value, Integral) or value < bound:
            raise ValueError(f"{name} must be a whole number of at least {bound}, got {value!r}")


def check_range(config: object, **ranges: tuple[float, float]) -> None:
    """Check fields of a config against the ranges that they must lie in. None passes where the field may be None.

    Args:
        config: A dataclass.
        ranges: Least and largest value of each field, by the field's name.

    Raises:
        ValueError: A value is out of its range, or no number. The message begins with the field's name.
    """
    for name, (low, high) in ranges.items():
        value = _number(config, name)
        if value is not None and not low <= value <= high:
            raise ValueError(f"{name} must lie in [{low:g}, {high:g}], got {value:g}")


def _number(config: object, name: str) -> float | None:
    """Return the value of a field of a config.

    Raises:
        ValueError: It is no number, and not None where the field may be None.
    """
    value = getattr(config, name)
    declared: dict[str, Field] = getattr(config, "__dataclass_fields__", {})
    if value is None and "None" in str(declared[name].type):
        return None
    if isinstance(value, bool) or not isinstance(value, Real):
        raise ValueError(f"{name} must be a number, got {value!r}")
    return cast(float, value)


def check_number(flag: str, value: float, may_be_infinite: bool = False) -> None:
    """Check that a number is finite and of a size that can be meant.

    Args:
        flag: The flag, for the message.
        value: Its value.
        may_be_infinite: Whether infinity stands for "no limit".

    Raises:
        ValueError: The number is NaN, infinite or beyond +-1e12, an integer beyond 64 bits. The message names the flag.
    """
    if value != value or (math.inf in (value, -value) and not may_be_infinite):
        raise ValueError(f"{flag} must be a finite number, got {value}")
    largest = LARGEST_INTEGER if isinstance(value, int) else LARGEST
    if not -largest <= value <= largest and math.inf not in (value, -value):
        raise ValueError(f"{flag} must lie within +-{float(largest):.3g}, got {value!r:.40}")
