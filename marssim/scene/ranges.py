"""Ranges that random values are drawn from."""

from __future__ import annotations

from collections.abc import Mapping

Range = tuple[float, float]  # low and high end; equal for a fixed value


def check_ranges(config: object, limits: Mapping[str, Range]) -> None:
    """Check a dataclass whose fields are all of type Range.

    Args:
        config: The dataclass.
        limits: Least and largest value of each field, by its name.

    Raises:
        ValueError: The ends of a range lie beyond its limits or come in the wrong order. The message begins with the
            field's name.
    """
    for name, (low, high) in vars(config).items():
        least, most = limits[name]
        if not least <= low <= high <= most:
            raise ValueError(f"{name} must be a range LOW HIGH within {least:g} and {most:g}, got {low} {high}")
