"""Check that numbers of a command's config are not too small."""

from __future__ import annotations


def check_least(config: object, **least: float) -> None:
    """Check fields of a config against their least values. None passes.

    Args:
        config: A dataclass.
        least: Least value of each field, by the field's name.

    Raises:
        ValueError: A value is smaller. The message begins with the field's name, of which a command makes the flag.
    """
    for name, bound in least.items():
        value = getattr(config, name)
        if value is not None and not value >= bound:
            raise ValueError(f"{name} must be at least {bound:g}, got {value}")
