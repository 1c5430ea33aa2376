"""Ranges that random values are drawn from."""

from __future__ import annotations

from collections.abc import Mapping

Range = tuple[float, float]  # low and high end; equal for a fixed value


def check_ranges(config: object, limits: Mapping[str, Range]) -> None:
    """Check fields of type Range.

    Args:
        config: The object that has the fields.
        limits: Least and largest value of each field to check, by its name.

    Raises:
        ValueError: The ends of a range lie beyond its limits or come in the wrong order. The message begins with the
            field's name.
    """
    for name, (least, most) in limits.items():
        low, high = getattr(config, name)
        if not least <= low <= high <= most:
            raise ValueError(f"{name} must be a range LOW HIGH within {least:g} and {most:g}, got {low} {high}")
