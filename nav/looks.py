"""Where a rover looked last, so that one that looks only once in a while stops for a look that shows something new."""

from __future__ import annotations

import numpy as np

from marssim.base.angle import wrapped

SAME_PLACE = 0.8  # [m] within which looks along one bearing show the same ground
SAME_BEARING = np.deg2rad(20.0)  # [rad] between two looks that show mostly the same ground: just under half a view


class Looks:
    """The looks taken near the rover."""

    def __init__(self) -> None:
        self._taken: list[np.ndarray] = []  # (3,) x, y [m] and bearing in the world [rad]

    def note(self, place: np.ndarray, pan: float) -> None:
        """Note a look, and forget those that were taken elsewhere.

        Args:
            place: (3,) x, y [m], yaw [rad] of the rover.
            pan: Pan of the mast [rad], positive to the left.
        """
        self._taken = [look for look in self._taken if _near(look, place)]
        self._taken.append(np.array([place[0], place[1], place[2] + pan]))

    def cover(self, place: np.ndarray, pan: float) -> bool:
        """Return whether a look from near this place has shown what one with this pan would; arguments as of note."""
        bearing = place[2] + pan
        return any(_near(look, place) and abs(wrapped(look[2] - bearing)) <= SAME_BEARING for look in self._taken)


def _near(look: np.ndarray, place: np.ndarray) -> bool:
    return bool(np.hypot(*(look - place)[:2]) <= SAME_PLACE)
