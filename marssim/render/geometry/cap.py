"""The cap of a scene's ground: a mesh that lies above all of its relief, where rays begin to look for the ground."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from marssim.render.geometry.mesh import SceneMesh, ground_mesh
from marssim.render.relief.ground import Ground
from marssim.render.relief.height import MOST_SWEPT, SAND_RELIEF, SOFT, SWEPT_DEPTH
from marssim.render.relief.stones.bodies import BARE, GRAVEL, SIDE, TOP
from marssim.render.relief.stones.tops import raise_at_stones
from marssim.render.relief.tiles import Tile
from marssim.scene.scene import Scene
from marssim.scene.terrain import HeightGrid

MARGIN = 1.2  # factor of the terrain's bulge between its nodes
GRAIN_TOP = 0.0012  # [m] height of the grain that the cap covers
SMALL = 0.011  # [m] stones up to this diameter count as lying everywhere
SPARSE = 4.0  # so do those of which a cell of the grid is this many times as wide
CLEAR = 1e-3  # [m] least height of the cap over the ground
SUPPORT = 2  # cells of the fine spline over which a coefficient counts
WALL = 3.0  # [m] depth of the wall under the edge of the fine grid, where it joins the coarse one


def ground_cap(scene: Scene, ground: Ground) -> SceneMesh:
    """Return the cap of a scene's ground."""
    terrain = scene.terrain
    raised = [
        replace(grid, heights=grid.heights + _bulge(grid) + _thickness(grid, ground) + CLEAR)
        for grid in (terrain.fine, terrain.coarse)
    ]
    mesh = ground_mesh(replace(terrain, fine=raised[0], coarse=raised[1]))
    return _with_wall(mesh, *raised)


def _bulge(grid: HeightGrid) -> np.ndarray:
    """Return how far the smooth surface rises above the triangles around each node (ny, nx) [m]."""
    ny, nx = grid.heights.shape
    h = grid.heights
    x, y = grid.x0 + (np.arange(nx - 1) + 0.5) * grid.cell, grid.y0 + (np.arange(ny - 1) + 0.5) * grid.cell
    all_x, all_y = grid.x0 + np.arange(nx) * grid.cell, grid.y0 + np.arange(ny) * grid.cell
    out = np.zeros_like(h)
    middle = grid.smooth_heights(*np.meshgrid(x, y)) - (h[:-1, :-1] + h[1:, 1:]) / 2
    across = grid.smooth_heights(*np.meshgrid(x, all_y)) - (h[:, :-1] + h[:, 1:]) / 2
    down = grid.smooth_heights(*np.meshgrid(all_x, y)) - (h[:-1] + h[1:]) / 2
    for part, where in (
        (middle, np.s_[:-1, :-1]), (middle, np.s_[1:, 1:]), (middle, np.s_[:-1, 1:]), (middle, np.s_[1:, :-1]),
        (across, np.s_[:, :-1]), (across, np.s_[:, 1:]), (down, np.s_[:-1]), (down, np.s_[1:]),
    ):  # fmt: skip
        out[where] = np.maximum(out[where], part)
    return MARGIN * out


def _thickness(grid: HeightGrid, ground: Ground) -> np.ndarray:
    """Return the greatest height of the relief over the smooth terrain around each node of a grid (ny, nx) [m]."""
    relief, cover = ground.relief, ground.relief.cover
    ny, nx = grid.heights.shape
    x, y = np.meshgrid(grid.x0 + np.arange(nx) * grid.cell, grid.y0 + np.arange(ny) * grid.cell, copy=False)
    share = ground.data[cover.share : cover.share + 3 * cover.nodes**2].reshape(cover.nodes, cover.nodes, 3)
    wide = 2 * int(np.ceil(grid.cell * cover.per_cell)) + 1
    highest, lowest_sand = _highest(share, wide), -_highest(-share[..., 0], wide)
    i, j = (np.clip(np.rint((at - cover.start) * cover.per_cell), 0, cover.nodes - 1).astype(int) for at in (x, y))
    sand, _, swept = np.moveaxis(highest[j, i], -1, 0)
    rough = float(relief.strength) * (1 - SAND_RELIEF * lowest_sand[j, i])
    out = rough * (_highest_around(ground.data, relief.fractal, grid.cell, x, y) + GRAIN_TOP)
    crest = np.maximum(_highest_around(ground.data, relief.ripples, grid.cell, x, y), 0)
    out += float(relief.ripple_height) * sand * crest
    if relief.bedrock:
        plates = _highest_around(ground.data, relief.plates, grid.cell, x, y) + SWEPT_DEPTH * np.minimum(
            swept, MOST_SWEPT
        )
        out = np.where(swept > 0, np.maximum(out, plates + SOFT), out)
    return out + _stone_tops(grid, ground) + _drift_tops(grid, ground)


def _highest(maps: np.ndarray, wide: int, border: int = cv2.BORDER_REPLICATE) -> np.ndarray:
    """Return the greatest value around each cell of maps (h, w) or (h, w, C).

    Args:
        maps: Of floats.
        wide: Cells along the side of the square around a cell, odd.
        border: How OpenCV goes on beyond the borders.
    """
    reach = wide // 2
    highest = cv2.copyMakeBorder(maps, reach, reach, reach, reach, border)
    covered = 1
    while covered < wide:  # twice as many cells with each pass, where cv2.dilate looks at each of them
        step = min(covered, wide - covered)
        highest = np.maximum(highest[:-step], highest[step:])
        highest = np.maximum(highest[:, :-step], highest[:, step:])
        covered += step
    return highest


def _drift_tops(grid: HeightGrid, ground: Ground) -> np.ndarray:
    """Return the greatest height of the drifts around each node of a grid (ny, nx) [m]."""
    ny, nx = grid.heights.shape
    nodes, base = len(ground.drifts), ground.relief.base
    if nodes == 0:
        return np.zeros((ny, nx))
    wide = 2 * (int(np.ceil(grid.cell * base.per_fine_cell)) + SUPPORT) + 1
    highest = _highest(ground.drifts, wide)
    i, j = (
        np.rint((first + np.arange(count) * grid.cell - base.fine_start) * base.per_fine_cell).astype(int)
        for first, count in ((grid.x0, nx), (grid.y0, ny))
    )
    inside = ((j >= 0) & (j < nodes))[:, None] & ((i >= 0) & (i < nodes))
    return np.where(inside, highest[np.ix_(np.clip(j, 0, nodes - 1), np.clip(i, 0, nodes - 1))], 0.0)


def _stone_tops(grid: HeightGrid, ground: Ground) -> np.ndarray:
    """Return the greatest height of the stones around each node of a grid (ny, nx) [m]."""
    octave, tops = ground.stones.octave, np.zeros(grid.heights.shape)
    lying = octave[:, [BARE, GRAVEL]].max(axis=1) > 0
    everywhere = lying & ((octave[:, SIDE] <= SMALL) | (grid.cell >= SPARSE * octave[:, SIDE]))
    if grid.cell < SPARSE * octave[-1, SIDE]:
        raise_at_stones(
            ground.data, ground.relief.cover, ground.stones.stone, octave, SMALL, float(grid.x0), float(grid.y0),
            float(grid.cell), tops,
        )  # fmt: skip
    return np.maximum(tops, (octave[:, TOP] * everywhere).max())


def _highest_around(data: np.ndarray, tile: Tile, reach: float, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the greatest height of a tile's finest level within `reach` [m] along x and y of points (...) [m]."""
    side = int(tile.side)
    level = data[tile.start : tile.start + side * side].reshape(side, side)
    nodes = int(np.ceil(np.sqrt(2) * reach / tile.spacing)) + 1
    if 2 * nodes + 1 >= side:
        return np.full(x.shape, level.max())
    around = _highest(level, 2 * nodes + 1, cv2.BORDER_WRAP)
    u = (tile.cosine * x - tile.sine * y) / tile.spacing + tile.offset
    v = (tile.sine * x + tile.cosine * y) / tile.spacing + tile.offset
    return around[np.rint(v).astype(int) % side, np.rint(u).astype(int) % side]


def _with_wall(mesh: SceneMesh, fine: HeightGrid, coarse: HeightGrid) -> SceneMesh:
    """Add a wall along the edge of the fine grid, so that no ray passes between the two grids."""
    ny, nx = fine.heights.shape
    index = np.arange(ny * nx).reshape(ny, nx)
    vertices, faces, counts, low, high = [mesh.vertices], [mesh.faces], [np.diff(mesh.start)], [mesh.low], [mesh.high]
    first = len(mesh.vertices)
    for edge in (index[0], index[-1], index[:, 0], index[:, -1]):
        top = mesh.vertices[edge].copy()
        foot = top - (0, 0, WALL)
        top[:, 2] = np.maximum(top[:, 2], coarse.gradient_at(top[:, 0], top[:, 1])[0]) + CLEAR
        vertices += [top, foot]
        n = len(edge)
        a = first + np.arange(n - 1)
        wall = np.stack([a, a + 1, a + n + 1, a, a + n + 1, a + n], axis=1).reshape(-1, 3)
        faces.append(wall.astype(np.int32))
        counts.append(np.array([len(wall)]))
        low.append((np.minimum(top, foot).min(axis=0) - 1e-9)[None])
        high.append((top.max(axis=0) + 1e-9)[None])
        first += 2 * n
    joined = np.concatenate(vertices)
    every = np.concatenate(faces)
    return SceneMesh(
        vertices=joined, faces=every, surface=np.zeros(len(every), dtype=np.int32),
        vertex_normals=np.zeros((len(joined), 3), dtype=np.float32),
        start=np.concatenate([[0], np.cumsum(np.concatenate(counts))]).astype(np.int64),
        low=np.concatenate(low), high=np.concatenate(high),
    )  # fmt: skip
