"""The check of an action of MarsNav-v0."""

from __future__ import annotations

import numpy as np

REAL = "fiub"  # kinds of NumPy's real numbers: floats, integers, and bool


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
        values = np.ma.filled(np.asanyarray(action), np.nan) if np.ma.isMaskedArray(action) else np.asarray(action)
    except Exception as error:  # of a driver's own type, such as a tensor that needs a gradient
        reason = str(error).partition("\n")[0]
        raise ActionError(f"action must be numbers of shape {shape}, got {_shown(action)}: {reason}") from None
    if action is not None and values.dtype.kind not in REAL:
        raise ActionError(f"action must be numbers of shape {shape}, got {_shown(action)}")
    if values.shape != shape:
        raise ActionError(f"action must be of shape {shape}, got {_shown(action)}")
    with np.errstate(over="ignore"):  # what is too large becomes infinite, and is refused below
        numbers = values.astype(np.float32)
    if not np.isfinite(numbers).all():
        raise ActionError(f"action must be finite, got {_shown(action)}")
    return np.clip(numbers, -1, 1)


def _shown(action: object) -> str:
    """Return an action as an error shows it: the name of its type if it has no text."""
    try:
        return f"{action!r:.80}"
    except Exception:  # of a driver's own type
        return type(action).__name__
