"""Ranges that random values are drawn from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

Range = tuple[float, float]  # low and high end; equal for a fixed value


def check_ranges(config: object, limits: Mapping[str, Range]) -> None:
    """Check fields of type Range.

    Args:
        config: The object that has the fields.
        limits: Least and largest value of each field to check, by its name.

    Raises:
        ValueError: A value is no range, or its ends lie beyond the limits or come in the wrong order. The message
            begins with the field's name.
    """
    for name, (least, most) in limits.items():
        ends = getattr(config, name)
        if not isinstance(ends, Sequence | np.ndarray) or len(ends) != 2:
            raise ValueError(f"{name} must be a range LOW HIGH, two equal numbers for a fixed value, got {ends!r}")
        low, high = ends
        if low == high and not least <= low <= most:
            raise ValueError(f"{name} must be within {least:g} and {most:g}, got {low}")
        if not least <= low <= high <= most:
            raise ValueError(f"{name} must be a range LOW HIGH within {least:g} and {most:g}, got {low} {high}")
