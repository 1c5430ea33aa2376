"""Angles in one turn."""

from __future__ import annotations

from typing import TypeVar

import numpy as np

Angle = TypeVar("Angle", float, np.ndarray)


def wrapped(angle: Angle) -> Angle:
    """Return the same angles in [-pi, pi] [rad]."""
    return (angle + np.pi) % (2 * np.pi) - np.pi
