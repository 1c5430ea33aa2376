"""Ranges that values are drawn from."""

from __future__ import annotations

from collections.abc import Mapping

Range = tuple[float, float]  # LOW HIGH, equal for a fixed value


def check_ranges(config: object, limits: Mapping[str, Range]) -> None:
    """Check a dataclass all of whose fields are a Range. limits: least and most of each, by name.

    Raises ValueError that begins with the field whose ends lie beyond them or come in the wrong order.
    """
    for name, (low, high) in vars(config).items():
        least, most = limits[name]
        if not least <= low <= high <= most:
            raise ValueError(f"{name} must be a range LOW HIGH within {least:g} and {most:g}, got {low} {high}")
