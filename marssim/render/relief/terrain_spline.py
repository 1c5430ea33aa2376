"""The grid of the terrain's fine square as a smooth surface, made finer so that drifts of sand can lie on it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from marssim.render.relief.bspline import cubic_coefficients
from marssim.scene.ground.drifts import EDGE  # the spline goes as far beyond the fine grid, to join the coarse one
from marssim.scene.terrain import Terrain


@dataclass(frozen=True)
class FineSpline:
    """The surface of the fine square.

    Attributes:
        coefficients: (N + 2, N + 2) of `cubic_coefficients` [m], rows northward.
        start: x and y of the first node [m].
        cell: Spacing of the nodes [m].
    """

    coefficients: np.ndarray
    start: float
    cell: float

    @classmethod
    def from_terrain(cls, terrain: Terrain) -> FineSpline:
        """Return the surface of a terrain's fine square, and a little of what lies around it."""
        fine, coarse = terrain.fine, terrain.coarse
        nodes = len(fine.heights) + 2 * EDGE
        start = fine.x0 - EDGE * fine.cell
        x, y = np.meshgrid(*[start + np.arange(nodes) * fine.cell] * 2)
        heights = np.empty((nodes, nodes))
        for part in (np.s_[:EDGE], np.s_[-EDGE:], np.s_[:, :EDGE], np.s_[:, -EDGE:]):
            heights[part] = coarse.smooth_heights(x[part], y[part])
        heights[EDGE:-EDGE, EDGE:-EDGE] = fine.heights
        return cls(cubic_coefficients(heights), start, fine.cell)

    @property
    def nodes(self) -> int:
        """N, the number of nodes along a side."""
        return len(self.coefficients) - 2

    def refined(self, cell: float) -> FineSpline:
        """Return the same surface on nodes that are at most `cell` [m] apart."""
        out = self
        while out.cell > cell:
            out = FineSpline(halved(halved(out.coefficients).T).T, out.start, out.cell / 2)
        return out

    def raised(self, heights: np.ndarray) -> FineSpline:
        """Return the surface with heights (N, N) [m] laid on it.

        These are taken for coefficients. So what lies on the ground is smoother than they are, and nowhere higher than
        the highest of the nodes within two cells.
        """
        return replace(self, coefficients=self.coefficients + np.pad(heights, 1, mode="edge"))


def halved(coefficients: np.ndarray) -> np.ndarray:
    """Return the coefficients of the same cubic B-splines on a grid of half the spacing, along the first axis.

    A cubic B-spline is the sum of five of half the width, with the binomial weights 1, 4, 6, 4, 1 over 8.

    Args:
        coefficients: (N + 2, ...) with a margin of one.

    Returns:
        (2 N + 1, ...) with a margin of one.
    """
    out = np.empty((2 * len(coefficients) - 3, *coefficients.shape[1:]), dtype=coefficients.dtype)
    out[::2] = (coefficients[:-1] + coefficients[1:]) / 2
    out[1::2] = (coefficients[:-2] + 6 * coefficients[1:-1] + coefficients[2:]) / 8
    return out
