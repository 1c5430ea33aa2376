"""The cost to reach the goal from everywhere: Dijkstra's search on a coarser grid, over known and unknown ground."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from nav.ground.elevation import ElevationMap
from nav.ground.traversability import Traversability


class DistanceField:
    """The cost to go to a goal [m] over the whole map, 8-connected; the goal may lie outside the map.

    Ground outside the map counts as easy: the straight distance joins every border cell to a goal outside.

    Attributes:
        values: (m, m) cost to go [m].
        inflated: (m, m) bool, cells that are too near to an obstacle.
    """

    def __init__(self, elevation: ElevationMap, coarse: int, inflated_cost: float) -> None:
        """Lay out the graph for a map of this size; `update` fills it.

        Args:
            elevation: The map.
            coarse: Map cells along one cell of the field.
            inflated_cost: Extra cost of a metre too near to an obstacle [m].
        """
        self.coarse = coarse
        self.inflated_cost = inflated_cost
        self.m = elevation.n // coarse
        self.cell = elevation.config.cell * coarse
        self.values = np.full((self.m, self.m), np.inf)
        self.inflated = np.zeros((self.m, self.m), bool)
        self.origin = elevation.origin
        index = np.arange(self.m**2).reshape(self.m, self.m)
        a, b, length = [], [], []
        for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
            left, right = max(0, -dx), max(0, dx)
            first = index[: self.m - dy, left : self.m - right].ravel()
            a.append(first)
            b.append(first + dy * self.m + dx)
            length.append(np.full(first.size, np.hypot(dx, dy) * self.cell / 2))
        self._a, self._b, self._half = np.concatenate(a), np.concatenate(b), np.concatenate(length)
        self._border = np.unique(np.concatenate([index[0], index[-1], index[:, 0], index[:, -1]]))
        # The sparsity never changes, so the matrix is laid out once and only its weights are updated.
        source = np.full(self._border.size, self.m**2)
        tail = np.concatenate([self._a, self._b, source])
        head = np.concatenate([self._b, self._a, self._border])
        layout = csr_matrix(
            (np.arange(1, tail.size + 1, dtype=float), (tail, head)), shape=(self.m**2 + 1, self.m**2 + 1)
        )
        layout.sort_indices()
        self._order = layout.data.astype(np.int64) - 1
        self._graph = layout

    def update(self, elevation: ElevationMap, ground: Traversability, goal: np.ndarray) -> None:
        """Compute the field to a goal.

        Args:
            elevation: The map.
            ground: The judged ground.
            goal: (2,) goal in the world [m]; it may lie outside the map.
        """
        m, k = self.m, self.coarse
        self.origin = elevation.origin
        fine = [np.s_[i : m * k : k, j : m * k : k] for i in range(k) for j in range(k)]
        # Gaps are as wide as on the map: a cell is too near to an obstacle if most of its map cells are.
        self.inflated = np.mean([ground.inflated[at] for at in fine], axis=0) > 0.5
        cost = np.maximum.reduce([ground.cost[at] for at in fine])
        coarse = (1.0 + cost + self.inflated_cost * self.inflated).ravel().astype(float)
        goal = np.asarray(goal, float)[:2]
        cell = np.floor((goal - self.origin) / self.cell).astype(int)
        inside = bool(((cell >= 0) & (cell < m)).all())
        if inside:
            link = np.full(self._border.size, 1e9)
            start = cell[1] * m + cell[0]
        else:
            xy = self.origin + (np.stack([self._border % m, self._border // m], axis=1) + 0.5) * self.cell
            link = np.hypot(*(xy - goal).T)
            start = m * m
        edge = (coarse[self._a] + coarse[self._b]) * self._half
        self._graph.data = np.concatenate([edge, edge, link])[self._order]
        self.values = dijkstra(self._graph, indices=start)[: m * m].reshape(m, m)

    def at(self, xy: np.ndarray) -> np.ndarray:
        """Return the interpolated cost to go [m] at world positions (..., 2) [m]; inf outside the map."""
        u = (np.asarray(xy, float) - self.origin) / self.cell - 0.5
        outside = ((u < -0.5) | (u > self.m - 0.5)).any(axis=-1)
        u = np.clip(u, 0, self.m - 1.001)
        i = u.astype(int)
        fx, fy = u[..., 0] - i[..., 0], u[..., 1] - i[..., 1]
        v, ix, iy = self.values, i[..., 0], i[..., 1]
        low = v[iy, ix] * (1 - fx) + v[iy, ix + 1] * fx
        high = v[iy + 1, ix] * (1 - fx) + v[iy + 1, ix + 1] * fx
        return np.where(outside, np.inf, low * (1 - fy) + high * fy)

    def is_inflated(self, xy: np.ndarray) -> np.ndarray:
        """Return whether world positions (..., 2) [m] are too near to an obstacle; outside the map, its edge counts."""
        cell = np.floor((np.asarray(xy, float) - self.origin) / self.cell).astype(int)
        ix, iy = np.moveaxis(np.clip(cell, 0, self.m - 1), -1, 0)
        return np.asarray(self.inflated[iy, ix])

    def path(self, start: np.ndarray, length: float) -> np.ndarray:
        """Return the path of steepest descent from a world position.

        Args:
            start: World position, x and y first [m].
            length: Length of the path [m]: it ends after as many cells as a straight path of this length has, or at the
                goal or the map's edge.

        Returns:
            (k, 2) world positions [m], the start included.
        """
        cell = np.floor((np.asarray(start, float)[:2] - self.origin) / self.cell).astype(int)
        points = [np.asarray(start, float)[:2]]
        for _ in range(int(length / self.cell)):
            x, y = cell
            if not (0 < x < self.m - 1 and 0 < y < self.m - 1):
                break
            near = self.values[y - 1 : y + 2, x - 1 : x + 2]
            best = np.unravel_index(np.argmin(near), near.shape)
            if near[best] >= self.values[y, x]:
                break
            cell = cell + np.array([best[1] - 1, best[0] - 1])
            points.append(self.origin + (cell + 0.5) * self.cell)
        return np.array(points)
