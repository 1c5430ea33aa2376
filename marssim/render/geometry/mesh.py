"""All triangles of a scene in one mesh, in compact pieces, so that a query costs only the pieces in its way."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from marssim.base.compute.compiled import compiled
from marssim.base.dataset.frame import GROUND
from marssim.render.geometry.gbuffer import ROCK_SMOOTHNESS
from marssim.render.geometry.seam import seam_cells, seam_triangles
from marssim.scene.look import SUN_RADIUS
from marssim.scene.scene import Scene
from marssim.scene.terrain import HeightGrid, Terrain

PIECE_CELLS = 12  # grid cells along a side of a piece of ground


@dataclass(frozen=True)
class Mesh:
    """Visible triangles.

    Attributes:
        vertices: (V, 3) float64, world frame [m].
        faces: (F, 3) int32.
        surface: (F,) int32 surface id of each face.
        vertex_normals: (V, 3) float32 for shading; shorter than 1 where facets stay visible, 0 for flat shading.
    """

    vertices: np.ndarray
    faces: np.ndarray
    surface: np.ndarray
    vertex_normals: np.ndarray


@dataclass(frozen=True)
class SceneMesh(Mesh):
    """Triangles of ground and bodies, in P pieces. The surface of a face is GROUND, or n + 1 for body n.

    Attributes:
        start: (P + 1,) first face of each piece: piece p holds faces[start[p] : start[p + 1]].
        low: (P, 3) lower corner of each piece's box [m].
        high: (P, 3) upper corner [m].
    """

    start: np.ndarray
    low: np.ndarray
    high: np.ndarray


def scene_mesh(scene: Scene) -> SceneMesh:
    """Return the mesh of a scene: its ground without gaps, and one piece for each body."""
    return _joined([closed_ground_mesh(scene.terrain), body_mesh(scene)])


def ground_mesh(terrain: Terrain) -> SceneMesh:
    """Return the triangles of a terrain's grids, the fine one and the coarse one around it, which do not meet."""
    return _joined([_fine_mesh(terrain), _grid_mesh(terrain.coarse, terrain.coarse_cells)])


def closed_ground_mesh(terrain: Terrain) -> SceneMesh:
    """Return the triangles of a terrain, with a strip of triangles between its grids that leaves no gap."""
    around = _grid_mesh(terrain.coarse, terrain.coarse_cells & ~seam_cells(terrain))
    return _joined([_fine_mesh(terrain), around, _seam_mesh(terrain)])


def _fine_mesh(terrain: Terrain) -> SceneMesh:
    return _grid_mesh(terrain.fine, np.ones(np.array(terrain.fine.heights.shape) - 1, dtype=bool))


def _seam_mesh(terrain: Terrain) -> SceneMesh:
    vertices, faces, cell = seam_triangles(terrain)
    begin = np.flatnonzero(np.diff(cell // PIECE_CELLS, prepend=-1))
    low = high = np.zeros((0, 3))
    if len(faces):
        corners = vertices[faces]
        low, high = np.minimum.reduceat(corners.min(axis=1), begin), np.maximum.reduceat(corners.max(axis=1), begin)
    return SceneMesh(
        vertices=vertices, faces=faces, surface=np.full(len(faces), GROUND, dtype=np.int32),
        vertex_normals=np.zeros((len(vertices), 3), dtype=np.float32),
        start=np.append(begin, len(faces)).astype(np.int64), low=low, high=high,
    )  # fmt: skip


def body_mesh(scene: Scene) -> SceneMesh:
    """Return the triangles of what stands on a scene's ground, one piece for each body."""
    rocks = scene.bodies
    start = np.searchsorted(rocks.face_rock, np.arange(len(rocks) + 1))
    low, high = _boxes(rocks.vertices, rocks.faces, start)
    return SceneMesh(
        vertices=rocks.vertices, faces=rocks.faces, surface=(rocks.face_rock + 1).astype(np.int32),
        vertex_normals=(ROCK_SMOOTHNESS * rocks.vertex_normals).astype(np.float32), start=start.astype(np.int64),
        low=low, high=high,
    )  # fmt: skip


@compiled
def _boxes(vertices, faces, start):
    """Return the least and the greatest coordinates (N, 3) of the faces of N pieces."""
    low = np.full((len(start) - 1, 3), np.inf)
    high = np.full((len(start) - 1, 3), -np.inf)
    for piece in range(len(low)):
        for face in range(start[piece], start[piece + 1]):
            for corner in range(3):
                for axis in range(3):
                    value = vertices[faces[face, corner], axis]
                    low[piece, axis] = min(low[piece, axis], value)
                    high[piece, axis] = max(high[piece, axis], value)
    return low, high


def _joined(parts: list[SceneMesh]) -> SceneMesh:
    first = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    faces = [part.faces + np.int32(offset) for part, offset in zip(parts, first)]
    counts = np.concatenate([np.diff(part.start) for part in parts])
    return SceneMesh(
        vertices=np.concatenate([part.vertices for part in parts]), faces=np.concatenate(faces),
        surface=np.concatenate([part.surface for part in parts]),
        vertex_normals=np.concatenate([part.vertex_normals for part in parts]),
        start=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        low=np.concatenate([part.low for part in parts]), high=np.concatenate([part.high for part in parts]),
    )  # fmt: skip


def faces_away_from(mesh: SceneMesh, sun: np.ndarray) -> SceneMesh:
    """Return the faces that are turned away from a part of the sun's disc, which are all that cast shadows.

    Ground and rocks are closed: a ray to the sun that passes through one enters by such a face and leaves by another.

    Args:
        mesh: The scene's mesh.
        sun: (3,) unit vector towards the sun's centre.

    Returns:
        A mesh of these faces, in the same pieces without empty ones.
    """
    face, count = _faces_away_from(mesh.vertices, mesh.faces, mesh.start, np.asarray(sun, dtype=float))
    some = np.flatnonzero(count)
    return SceneMesh(
        vertices=mesh.vertices, faces=mesh.faces[face], surface=mesh.surface[face], vertex_normals=mesh.vertex_normals,
        start=np.concatenate([[0], np.cumsum(count[some])]), low=mesh.low[some], high=mesh.high[some],
    )  # fmt: skip


@compiled
def _faces_away_from(vertices, faces, start, sun):
    """Return the faces turned away from a part of the sun, and how many of them are in each piece."""
    out = np.empty(len(faces), dtype=np.int64)
    count = np.zeros(len(start) - 1, dtype=np.int64)
    total = 0
    for piece in range(len(count)):
        for face in range(start[piece], start[piece + 1]):
            i, j, m = faces[face, 0], faces[face, 1], faces[face, 2]
            ux, uy, uz = (
                vertices[j, 0] - vertices[i, 0],
                vertices[j, 1] - vertices[i, 1],
                vertices[j, 2] - vertices[i, 2],
            )
            tx, ty, tz = (
                vertices[m, 0] - vertices[i, 0],
                vertices[m, 1] - vertices[i, 1],
                vertices[m, 2] - vertices[i, 2],
            )
            nx, ny, nz = uy * tz - uz * ty, uz * tx - ux * tz, ux * ty - uy * tx
            grazing = SUN_RADIUS * math.sqrt(nx * nx + ny * ny + nz * nz)
            if nx * sun[0] + ny * sun[1] + nz * sun[2] < grazing:
                out[total] = face
                count[piece] += 1
                total += 1
    return out[:total], count


def _grid_mesh(grid: HeightGrid, keep: np.ndarray) -> SceneMesh:
    """Return the triangles of a grid, block by block. keep: (ny - 1, nx - 1) bool, the cells to include."""
    vertices, faces = grid.mesh(keep)
    row, column = np.nonzero(keep)
    blocks = -(-keep.shape[1] // PIECE_CELLS)
    block = (row // PIECE_CELLS) * blocks + column // PIECE_CELLS
    order = np.argsort(block, kind="stable")
    faces = np.ascontiguousarray(faces.reshape(-1, 2, 3)[order].reshape(-1, 3))
    block = block[order]
    begin = np.flatnonzero(np.diff(block, prepend=-1))
    corner = grid.heights[:-1, :-1], grid.heights[:-1, 1:], grid.heights[1:, :-1], grid.heights[1:, 1:]
    lowest = np.minimum(np.minimum(*corner[:2]), np.minimum(*corner[2:]))[keep][order]
    highest = np.maximum(np.maximum(*corner[:2]), np.maximum(*corner[2:]))[keep][order]
    x, y = grid.x0 + column[order] * grid.cell, grid.y0 + row[order] * grid.cell
    low = np.stack([np.minimum.reduceat(v, begin) for v in (x, y, lowest)], axis=1)
    high = np.stack([np.maximum.reduceat(v, begin) for v in (x + grid.cell, y + grid.cell, highest)], axis=1)
    slack = 1e-9 * np.abs(grid.x0)  # because grid lines are computed in more than one way
    counts = 2 * np.diff(begin, append=len(block))
    return SceneMesh(
        vertices=vertices, faces=faces, surface=np.full(len(faces), GROUND, dtype=np.int32),
        vertex_normals=np.zeros((len(vertices), 3), dtype=np.float32),
        start=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64), low=low - slack, high=high + slack,
    )  # fmt: skip
