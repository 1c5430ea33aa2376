"""Heights on a grid as a surface of triangles."""

from __future__ import annotations

import numpy as np

from marssim.base.view.scene import Surface


def grid_surface(name: str, first: np.ndarray, cell: float, heights: np.ndarray, colours: np.ndarray) -> Surface | None:
    """Return heights on a grid as a surface that faces up; None without four known neighbours in a square.

    Args:
        name: Name of the surface.
        first: (2,) x and y of heights[0, 0] [m], world frame.
        cell: Distance of neighbours [m].
        heights: (r, c) world z [m], indexed [iy, ix]; NaN where unknown.
        colours: (r, c, 3) uint8 RGB.
    """
    valid = np.isfinite(heights)
    rows, columns = valid.shape
    index = np.arange(rows * columns).reshape(rows, columns)
    whole = valid[:-1, :-1] & valid[:-1, 1:] & valid[1:, :-1] & valid[1:, 1:]
    if not whole.any():
        return None
    a, b, c, d = (part[whole] for part in (index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]))
    corners = np.concatenate([np.stack([a, b, d], axis=1), np.stack([a, d, c], axis=1)])
    used, faces = np.unique(corners, return_inverse=True)
    y, x = np.divmod(used, columns)
    vertices = np.column_stack([first + cell * np.stack([x, y], axis=1), heights.reshape(-1)[used]])
    return Surface(name, vertices, faces.reshape(-1, 3), colours.reshape(-1, 3)[used])
