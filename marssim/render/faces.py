"""From roughly where a ray meets a surface to exactly which triangle it meets, and where.

A rasteriser's depth buffer is single precision and knows no triangles. The ground's triangle follows from the grid, a
rock's from the direction in which the point lies from the rock's centre (rocks are star-shaped); the ray is then
intersected with the triangle's plane.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from marssim.render.gbuffer import ROCK_SMOOTHNESS
from marssim.scene.rocks import Rocks, icosphere
from marssim.scene.terrain import HeightGrid

ROUNDS = 3  # a point that slides over an edge when it is put on the plane is tried on the neighbour, so many times
WALK = 48  # steps from face to face, at most
TABLE = 24  # cells along each axis of the direction table
INSIDE = -1e-6  # barycentric coordinate from which a point counts as within a face


class GroundFaces:
    """The triangles of a height grid."""

    def __init__(self, grid: HeightGrid) -> None:
        self.grid = grid
        self._normals = grid.vertex_normals().astype(np.float32)
        self._heights = np.ascontiguousarray(grid.heights).ravel()

    def meet(self, eye: np.ndarray, rays: np.ndarray, reach: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Where rays that meet the ground near a guess do meet it.

        eye: (3,); rays: (N, 3) any length; reach: (N,) guess, in units of the ray.
        Returns reach (N,), unit face normal (N, 3) and interpolated normal (N, 3) float32, in the world frame.
        """
        n = len(rays)
        out = np.empty(n)
        normal, smooth = np.empty((2, n, 3), dtype=np.float32)
        todo, guess, ray = np.arange(n), reach, rays
        for _ in range(ROUNDS):
            i, j, lower, h00, gx, gy = self._triangle(eye[0] + guess * ray[:, 0], eye[1] + guess * ray[:, 1])
            x, y = self.grid.x0 + i * self.grid.cell, self.grid.y0 + j * self.grid.cell
            slant = ray[:, 2] - gx * ray[:, 0] - gy * ray[:, 1]
            rise = h00 - eye[2] - gx * (x - eye[0]) - gy * (y - eye[1])
            t = rise / np.where(np.abs(slant) < 1e-9, np.nan, slant)
            t = np.where(np.isfinite(t) & (t > 0), t, guess)
            out[todo] = t
            unit = 1 / np.sqrt(1 + gx * gx + gy * gy)
            normal[todo, 0], normal[todo, 1], normal[todo, 2] = -gx * unit, -gy * unit, unit
            s = (eye[0] + t * ray[:, 0] - x) / self.grid.cell
            u = (eye[1] + t * ray[:, 1] - y) / self.grid.cell
            big, small = np.where(lower, s, u), np.where(lower, u, s)
            smooth[todo] = self._blend(i, j, lower, big, small)
            slid = (small < INSIDE) | (big > 1 - INSIDE) | (small > big - INSIDE)
            todo, guess, ray = todo[slid], t[slid], ray[slid]
            if len(todo) == 0:
                break
        return out, normal, smooth

    def _triangle(self, x: np.ndarray, y: np.ndarray):
        """Cell, half of the cell, height of the cell's corner and slopes of the triangle below each point."""
        i, j, s, t = self.grid.locate(x, y)
        h, nx = self._heights, self.grid.heights.shape[1]
        corner = j * nx + i
        lower = s >= t
        h00, h11 = h.take(corner), h.take(corner + nx + 1)
        side = h.take(corner + np.where(lower, 1, nx))  # the third corner: (1, 0) below the diagonal, (0, 1) above it
        first, second = (side - h00) / self.grid.cell, (h11 - side) / self.grid.cell
        return i, j, lower, h00, np.where(lower, first, second), np.where(lower, second, first)

    def _blend(self, i: np.ndarray, j: np.ndarray, lower: np.ndarray, big: np.ndarray, small: np.ndarray) -> np.ndarray:
        """Vertex normals interpolated: big, small are the larger and the smaller of the place within the cell."""
        nx = self.grid.heights.shape[1]
        corner = j * nx + i
        a, c = self._normals.take(corner, 0), self._normals.take(corner + nx + 1, 0)
        b = self._normals.take(corner + np.where(lower, 1, nx), 0)
        big, small = big.astype(np.float32), small.astype(np.float32)
        return (1 - big)[:, None] * a + (big - small)[:, None] * b + small[:, None] * c


class RockFaces:
    """The triangles of all rocks of a scene, found by direction from each rock's centre."""

    def __init__(self, rocks: Rocks) -> None:
        self._rocks = rocks
        self._start = np.searchsorted(rocks.face_rock, np.arange(len(rocks) + 1))
        count = np.diff(self._start)
        self._level = np.round(np.log2(np.maximum(count, 1) / 20) / 2).astype(int)
        self._unstretch = np.empty((len(rocks), 3, 3))
        for level in np.unique(self._level):
            members = np.flatnonzero(self._level == level)
            direction, template = icosphere(int(level))
            offset = rocks.faces[self._start[members], 0] - template[0, 0]
            spoke = rocks.vertices[offset[:, None] + np.arange(len(direction))] - rocks.centre[members, None]
            # directions of an icosphere are orthogonal as columns, so this is the least-squares linear map
            linear = np.einsum("nvi,vj->nij", spoke, direction) * (3 / len(direction))
            self._unstretch[members] = np.linalg.inv(linear)

    def meet(
        self, eye: np.ndarray, rays: np.ndarray, reach: np.ndarray, rock: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Where rays that meet rock `rock` (N,) near a guess do meet it; otherwise as GroundFaces.meet."""
        n = len(rays)
        out = reach.copy()
        normal, smooth = np.empty((2, n, 3), dtype=np.float32)
        centre = self._rocks.centre[rock]
        face = self._guess(eye + reach[:, None] * rays - centre, rock)
        todo = np.arange(n)
        for _ in range(ROUNDS):
            spoke = eye + out[todo, None] * rays[todo] - centre[todo]
            face[todo] = self._walk(spoke, rock[todo], face[todo])
            index = self._rocks.faces[face[todo]]
            a, b, c = (self._rocks.vertices[index[:, k]] for k in range(3))
            cross = np.cross(b - a, c - a)
            slant = np.einsum("ij,ij->i", cross, rays[todo])
            t = np.einsum("ij,ij->i", cross, a - eye) / np.where(slant == 0, np.nan, slant)
            good = np.isfinite(t) & (t > 0) & (slant < 0)
            t = np.where(good, t, out[todo])
            p = eye + t[:, None] * rays[todo]
            area = np.maximum(np.einsum("ij,ij->i", cross, cross), 1e-300)
            u = np.einsum("ij,ij->i", np.cross(p - a, c - a), cross) / area
            v = np.einsum("ij,ij->i", np.cross(b - a, p - a), cross) / area
            normal[todo] = cross / np.sqrt(area)[:, None]
            weight = ROCK_SMOOTHNESS * np.clip(np.stack([1 - u - v, u, v], axis=1), 0, 1)
            smooth[todo] = np.einsum("ij,ijk->ik", weight, self._rocks.vertex_normals[index])
            out[todo] = t
            todo = todo[good & ((u < INSIDE) | (v < INSIDE) | (u + v > 1 - INSIDE))]
            if len(todo) == 0:
                break
        return out, normal, smooth

    def _guess(self, spoke: np.ndarray, rock: np.ndarray) -> np.ndarray:
        """A face near each direction from the rock's centre."""
        direction = np.einsum("nij,nj->ni", self._unstretch[rock], spoke)
        direction /= np.maximum(np.abs(direction).max(axis=1, keepdims=True), 1e-12)
        cell = np.minimum(((direction + 1) * (TABLE / 2)).astype(int), TABLE - 1)
        cell = (cell[:, 0] * TABLE + cell[:, 1]) * TABLE + cell[:, 2]
        level = self._level[rock]
        out = self._start[rock]
        for value in np.unique(level):
            of_level = level == value
            out[of_level] += _direction_table(int(value))[cell[of_level]]
        return out

    def _walk(self, spoke: np.ndarray, rock: np.ndarray, face: np.ndarray) -> np.ndarray:
        """Step over the edge that parts the face from the direction until the face's cone holds the direction."""
        face = face.copy()
        todo = np.arange(len(face))
        for _ in range(WALK):
            centre = self._rocks.centre[rock[todo]][:, None]
            corner = self._rocks.vertices[self._rocks.faces[face[todo]]] - centre
            side = np.einsum("nij,nj->ni", np.cross(corner, np.roll(corner, -1, axis=1)), spoke[todo])
            worst = side.argmin(axis=1)
            moving = side[np.arange(len(todo)), worst] < 0
            todo, worst = todo[moving], worst[moving]
            if len(todo) == 0:
                break
            level = self._level[rock[todo]]
            first = self._start[rock[todo]]
            local = face[todo] - first
            for value in np.unique(level):
                of_level = level == value
                beyond = _neighbours(int(value))[local[of_level], worst[of_level]]
                face[todo[of_level]] = first[of_level] + beyond
        return face


@lru_cache(maxsize=8)
def _neighbours(level: int) -> np.ndarray:
    """(F, 3) face beyond the edge from corner k to corner k + 1 of each face of the icosphere."""
    faces = icosphere(level)[1]
    edge = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2).astype(np.int64)
    big = int(faces.max()) + 1
    forth, back = edge[:, 0] * big + edge[:, 1], edge[:, 1] * big + edge[:, 0]
    order = np.argsort(forth)
    return (order[np.searchsorted(forth[order], back)] // 3).reshape(-1, 3)


@lru_cache(maxsize=8)
def _direction_table(level: int) -> np.ndarray:
    """(TABLE^3,) face of the icosphere nearest to the direction of each cell of the cube [-1, 1]^3."""
    direction, faces = icosphere(level)
    middle = direction[faces].mean(axis=1)
    axis = (np.arange(TABLE) + 0.5) * 2 / TABLE - 1
    cell = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    return (cell @ middle.T).argmax(axis=1)
