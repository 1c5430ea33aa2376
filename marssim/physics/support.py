"""The surface that carries the rover: height rasters of ground and rocks, and a mask of obstacles.

Rocks are all bodies of a scene here, slabs, blocks of ledges and fragments too.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from marssim.engines.embree import TriangleRays
from marssim.scene.rocks.mesh import Rocks
from marssim.scene.rocks.shapes import icosphere
from marssim.scene.scene import Scene

SMALLEST_ROCK = 0.10  # [m] diameter of the smallest rock that matters to a wheel of 0.15 m radius
SMALL = 0.2  # [m] diameter of rocks under which collision shapes have fewer faces
MOST_LOST = 0.2  # largest length that these may lose by it, over the diameter
RASTER_CELL = 0.05  # [m] grid spacing of the rasters


@dataclass(frozen=True)
class SupportMap:
    """Rasters over the finely gridded square of a scene; row j lies at y = y0 + j cell, column i at x = x0 + i cell.

    Attributes:
        drive: (n, n) height of the surface that wheels stand on [m]: ground and rocks that are no obstacles.
        top: (n, n) height of the surface with every rock [m].
        ground: (n, n) height of the surface without rocks [m].
        obstacle: (n, n) bool, the cells under the outline of a rock whose exposed height is obstacle_height or more.
        x0: East coordinate of column 0 [m].
        y0: North coordinate of row 0 [m].
        cell: Grid spacing [m].
    """

    drive: np.ndarray
    top: np.ndarray
    ground: np.ndarray
    obstacle: np.ndarray
    x0: float
    y0: float
    cell: float

    @classmethod
    def from_scene(cls, scene: Scene, obstacle_height: float, cell: float = RASTER_CELL) -> SupportMap:
        """Build the rasters of a scene.

        Args:
            scene: The scene.
            obstacle_height: Exposed height from which on a rock is an obstacle [m].
            cell: Grid spacing [m].
        """
        x0, y0, x1, y1 = scene.terrain.fine.bounds
        nx, ny = round((x1 - x0) / cell) + 1, round((y1 - y0) / cell) + 1
        x, y = x0 + np.arange(nx) * cell, y0 + np.arange(ny) * cell
        ground = scene.terrain.fine.gradient_at(*np.meshgrid(x, y))[0]
        climbable, blocking = split_rocks(scene, obstacle_height)
        drive = np.maximum(ground, _rock_tops(scene.bodies, climbable, x, y))
        tall = _rock_tops(scene.bodies, blocking, x, y)
        return cls(
            drive=drive, top=np.maximum(drive, tall), ground=ground, obstacle=tall > ground, x0=x0, y0=y0, cell=cell
        )

    def sample(self, raster: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Interpolate one of the rasters bilinearly at x, y (...) [m]; outside, return that of the nearest edge."""
        ny, nx = raster.shape
        fx = np.clip((x - self.x0) / self.cell, 0, nx - 1.000001)
        fy = np.clip((y - self.y0) / self.cell, 0, ny - 1.000001)
        i, j = fx.astype(np.intp), fy.astype(np.intp)
        s, t = fx - i, fy - j
        flat, index = raster.reshape(-1), j * nx + i
        low = flat[index] * (1 - s) + flat[index + 1] * s
        high = flat[index + nx] * (1 - s) + flat[index + nx + 1] * s
        return low * (1 - t) + high * t

    def nearest(self, raster: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return a raster's value in the cell nearest to x, y (...) [m]; outside, that of the nearest edge."""
        ny, nx = raster.shape
        i = np.clip(np.rint((x - self.x0) / self.cell).astype(np.intp), 0, nx - 1)
        j = np.clip(np.rint((y - self.y0) / self.cell).astype(np.intp), 0, ny - 1)
        return raster[j, i]

    def contains(self, x: float, y: float) -> bool:
        """Return whether x, y [m] lies on the rasters, edges included."""
        ny, nx = self.drive.shape
        return self.x0 <= x <= self.x0 + (nx - 1) * self.cell and self.y0 <= y <= self.y0 + (ny - 1) * self.cell


def split_rocks(scene: Scene, obstacle_height: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the indices of the rocks that the rover can drive over, and of those that block it.

    Slabs, blocks of ledges and fragments are rocks here: the indices are those of Scene.bodies. Only those in the
    scene's fine square with a diameter of at least SMALLEST_ROCK count.

    Args:
        scene: The scene.
        obstacle_height: Exposed height from which on a rock blocks [m].
    """
    rocks, (x0, y0, x1, y1) = scene.bodies, scene.terrain.fine.bounds
    x, y, reach = rocks.centre[:, 0], rocks.centre[:, 1], rocks.diameter
    near = (x > x0 - reach) & (x < x1 + reach) & (y > y0 - reach) & (y < y1 + reach) & (reach >= SMALLEST_ROCK)
    tall = rocks.height >= obstacle_height
    return np.flatnonzero(near & ~tall), np.flatnonzero(near & tall)


def coarse_faces(rocks: Rocks, members: np.ndarray) -> np.ndarray:
    """Return the faces (F, 3) of some rocks on fewer of their vertices, for collision.

    The first vertices of an icosphere are those of its coarser levels, so the faces of a coarser level simplify a rock.
    Rocks under SMALL are simplified further, unless they lose much of their length. A rock that is no icosphere keeps
    all its faces.
    """
    faces, rock = rocks.faces, rocks.face_rock
    out = []
    keys = np.asarray(members, dtype=rock.dtype)  # with another dtype, searchsorted would copy all of `rock`
    starts, ends = np.searchsorted(rock, keys), np.searchsorted(rock, keys, side="right")
    for member, start, end in zip(members, starts, ends):
        part = whole = faces[start:end]
        if len(whole) > len(icosphere(1)[1]) and _is_icosphere(whole):
            corners = rocks.vertices[whole.min() : whole.max() + 1]
            small = rocks.diameter[member] < SMALL and _lost(corners) < MOST_LOST * rocks.diameter[member]
            template = icosphere(1 if small else 2)[1]
            part = template + whole.min() if len(whole) > len(template) else whole
        out.append(part)
    return np.concatenate(out) if out else np.zeros((0, 3), np.int32)


def _lost(corners: np.ndarray) -> float:
    """Return the length that an icosphere's shape (V, 3) [m] loses along an axis on the vertices of level 1 [m]."""
    first = corners[: icosphere(1)[1].max() + 1]
    return float(np.abs(np.ptp(corners, axis=0) - np.ptp(first, axis=0)).max())


def _is_icosphere(faces: np.ndarray) -> bool:
    level = round(np.log2(max(len(faces), 20) / 20) / 2)
    if len(faces) != 20 * 4**level:
        return False
    return bool(np.array_equal(faces - faces.min(), icosphere(level)[1]))


def _rock_tops(rocks: Rocks, members: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the highest rock surface over each node, (len(y), len(x)) [m], by vertical rays; -inf without a rock."""
    out = np.full((len(y), len(x)), -np.inf)
    if len(members) == 0:
        return out
    used, index = np.unique(coarse_faces(rocks, members), return_inverse=True)
    vertices = rocks.vertices[used]
    near = np.zeros(out.shape, dtype=np.uint8)  # rays are cast only within the rocks' bounding circles
    cell = x[1] - x[0]
    radius = 1.5 * rocks.diameter[members] / cell + 1
    at = np.rint((rocks.centre[members, :2] - (x[0], y[0])) / cell).astype(int)
    for centre, r in zip(at.tolist(), radius):
        cv2.circle(near, centre, int(np.ceil(r)), 1, thickness=-1)
    row, column = np.nonzero(near)
    above = float(vertices[:, 2].max()) + 1.0
    origins = np.stack([x[column], y[row], np.full(len(row), above)], axis=1)
    face, below = TriangleRays(vertices, index.reshape(-1, 3)).meet(origins, np.broadcast_to([0, 0, -1], origins.shape))
    hit = face >= 0
    out[row[hit], column[hit]] = above - below[hit]
    return out
