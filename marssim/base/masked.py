"""Masked arrays, as readers of rasters return them, taken for plain arrays."""

from __future__ import annotations

from typing import Any

import numpy as np


def filled(values: Any) -> np.ndarray:
    """Return an array without a mask, with NaN where numpy.ma masks a value: numpy.asarray would show what it hides."""
    if isinstance(values, np.ma.MaskedArray) and np.ma.is_masked(values):
        values = values if np.issubdtype(values.dtype, np.floating) else values.astype(float)
        return values.filled(np.nan)
    return np.asarray(values)
