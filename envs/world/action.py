"""The check of an action of MarsNav-v0."""

from __future__ import annotations

import numpy as np


class ActionError(ValueError):
    """The environment got an action that it cannot carry out; the message says what was expected."""


def checked_action(action: object, shape: tuple[int, ...]) -> np.ndarray:
    """Return an action as numbers, clipped to [-1, 1].

    Args:
        action: What a driver or a policy returned.
        shape: The shape that it must have.

    Returns:
        float32 of that shape.

    Raises:
        ActionError: It is no such array, or not finite.
    """
    try:
        with np.errstate(over="ignore"):  # what is too large becomes infinite, and is refused below
            numbers = np.asarray(action, dtype=np.float32)
    except (TypeError, ValueError, OverflowError):
        raise ActionError(f"action must be numbers of shape {shape}, got {action!r:.80}") from None
    if action is None or numbers.shape != shape:
        raise ActionError(f"action must be of shape {shape}, got {action!r:.80}")
    if not np.isfinite(numbers).all():
        raise ActionError(f"action must be finite, got {action!r:.80}")
    return np.clip(numbers, -1, 1)
