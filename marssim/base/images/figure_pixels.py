"""Figures of matplotlib as pixels, drawn by Agg: no display, no global state."""

from __future__ import annotations

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure


def figure_pixels(figure: Figure) -> np.ndarray:
    """Draw a figure.

    Args:
        figure: The figure.

    Returns:
        (H, W, 3) uint8 RGB.
    """
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[..., :3])
