"""The check of an action of MarsNav-v0."""

from __future__ import annotations

import gymnasium
import numpy as np

from envs.world.referee import DRIVING

NO_NUMBERS = "USMmc"  # kinds of NumPy's types that are cast to float though they are no real numbers


class ActionError(ValueError):
    """The environment got an action that it cannot carry out; the message says what was expected."""


def warn_if_ended(outcome: str) -> None:
    """Warn if a step follows the end of an episode; its reward has no meaning. outcome: That before the step."""
    if outcome != DRIVING:
        gymnasium.logger.warn(f"step was called after the episode ended ({outcome}): call reset first")


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
        values = np.ma.filled(action.astype(float), np.nan) if np.ma.isMaskedArray(action) else np.asarray(action)
        if values.dtype.kind in NO_NUMBERS:
            raise TypeError(f"its numbers are of type {values.dtype}")
        with np.errstate(over="ignore"):  # what is too large becomes infinite, and is refused below
            numbers = values.astype(np.float32)
    except Exception as error:  # of a driver's own type, such as a tensor that needs a gradient
        reason = str(error).partition("\n")[0]
        raise ActionError(f"action must be numbers of shape {shape}, got {_shown(action)}: {reason}") from None
    if action is None or numbers.shape != shape:
        raise ActionError(f"action must be of shape {shape}, got {_shown(action)}")
    if not np.isfinite(numbers).all():
        raise ActionError(f"action must be finite, got {_shown(action)}")
    return np.clip(numbers, -1, 1)


def _shown(action: object) -> str:
    """Return an action as an error shows it: the name of its type if it has no text."""
    try:
        return f"{action!r:.80}"
    except Exception:  # of a driver's own type
        return type(action).__name__
