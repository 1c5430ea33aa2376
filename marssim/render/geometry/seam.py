"""The strip of triangles that joins a terrain's fine grid to the coarse one around it.

Each edge of the coarse grid spans many nodes of the fine one, which lie up to some centimetres off it. The strip takes
the place of the coarse cells beside the fine grid, and takes its corners from both grids, so that no gap is left.
"""

from __future__ import annotations

import numpy as np

from marssim.scene.terrain import HeightGrid, Terrain


def seam_cells(terrain: Terrain) -> np.ndarray:
    """Return the cells of the coarse grid that have an edge on the fine one: (ny - 1, nx - 1) bool."""
    outside = terrain.coarse_cells
    out = np.zeros_like(outside)
    out[1:] |= ~outside[:-1]
    out[:-1] |= ~outside[1:]
    out[:, 1:] |= ~outside[:, :-1]
    out[:, :-1] |= ~outside[:, 1:]
    return out & outside


def seam_triangles(terrain: Terrain) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the triangles of the strip, facing upward.

    Returns:
        Vertices (V, 3) float64 [m]; faces (F, 3) int32; and the coarse cell (F,) int64 that each face lies in, counted
        along the strip, in ascending order.
    """
    vertices, faces, cells = [np.zeros((0, 3))], [np.zeros((0, 3), dtype=np.int32)], [np.zeros(0, dtype=np.int64)]
    vertex = cell = 0
    if seam_cells(terrain).any():
        for inner, outer in _sides(terrain):
            face, at = _zipped(inner, outer)
            order = np.argsort(at, kind="stable")
            vertices += [inner, outer]
            faces.append(face[order] + np.int32(vertex))
            cells.append(at[order] + cell)
            vertex, cell = vertex + len(inner) + len(outer), cell + len(outer) - 1
    return np.concatenate(vertices), np.concatenate(faces), np.concatenate(cells)


def _sides(terrain: Terrain) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return, for each side of the fine grid, its nodes and those of the coarse grid beyond, (N, 3) and (M, 3) [m].

    Both lines begin and end at the corners of the fine grid; on their left is the outside.
    """
    fine, coarse = terrain.fine, terrain.coarse
    x0, y0, x1, y1 = fine.bounds
    left, right = (round((x - coarse.x0) / coarse.cell) for x in (x0, x1))
    low, high = (round((y - coarse.y0) / coarse.cell) for y in (y0, y1))
    inner, outer = _nodes(fine), _nodes(coarse)
    return [
        (inner[-1], outer[high + 1, left : right + 1]),
        (inner[::-1, -1], outer[low : high + 1, right + 1][::-1]),
        (inner[0, ::-1], outer[low - 1, left : right + 1][::-1]),
        (inner[:, 0], outer[low : high + 1, left - 1]),
    ]


def _nodes(grid: HeightGrid) -> np.ndarray:
    ny, nx = grid.heights.shape
    x, y = grid.x0 + np.arange(nx) * grid.cell, grid.y0 + np.arange(ny) * grid.cell
    return np.stack([*np.meshgrid(x, y), grid.heights], axis=-1)


def _zipped(inner: np.ndarray, outer: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Join two lines by triangles: each piece of the one line to the nearest node of the other.

    Returns:
        Faces (F, 3) int32 among the nodes of `inner` and, after them, of `outer`; and the piece (F,) of `outer` that
        each lies beside.
    """
    n, m = len(inner), len(outer)
    # both lines are straight and evenly spaced
    nearest = np.rint((np.arange(m - 1) + 0.5) * (n - 1) / (m - 1)).astype(np.int64)
    i, j = np.arange(n - 1), np.arange(m - 1)
    beside = np.searchsorted(nearest, i, side="right")
    faces = np.concatenate([np.stack([i, i + 1, n + beside], axis=1), np.stack([n + j + 1, n + j, nearest], axis=1)])
    return faces.astype(np.int32), np.concatenate([np.minimum(beside, m - 2), j])
