"""What carries the rover: height rasters of ground and rocks, and where obstacles stand."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from marssim.engines.embree import TriangleRays
from marssim.scene.rocks import Rocks, icosphere
from marssim.scene.scene import Scene

SMALLEST_ROCK = 0.10  # [m] diameter of the smallest rock that matters to a wheel of 0.15 m radius
RASTER_CELL = 0.05  # [m]


@dataclass(frozen=True)
class SupportMap:
    """Rasters over the finely gridded square of a scene; row j is y = y0 + j cell, column i is x = x0 + i cell.

    drive: (n, n) [m] surface that wheels stand on: ground and rocks that are no obstacles. top: (n, n) [m] surface with
    every rock. ground: (n, n) [m] surface without rocks. obstacle: (n, n) bool, under the outline of a rock that
    stands out by obstacle_height or more.
    """

    drive: np.ndarray
    top: np.ndarray
    ground: np.ndarray
    obstacle: np.ndarray
    x0: float
    y0: float
    cell: float

    @classmethod
    def of(cls, scene: Scene, obstacle_height: float, cell: float = RASTER_CELL) -> SupportMap:
        """Build the rasters. obstacle_height [m]: exposed height from which on a rock is an obstacle."""
        x0, y0, x1, y1 = scene.terrain.fine.bounds
        nx, ny = round((x1 - x0) / cell) + 1, round((y1 - y0) / cell) + 1
        x, y = x0 + np.arange(nx) * cell, y0 + np.arange(ny) * cell
        ground = scene.terrain.fine.gradient_at(*np.meshgrid(x, y))[0]
        climbable, blocking = split_rocks(scene, obstacle_height)
        drive = np.maximum(ground, _rock_tops(scene.rocks, climbable, x, y))
        tall = _rock_tops(scene.rocks, blocking, x, y)
        return cls(
            drive=drive, top=np.maximum(drive, tall), ground=ground, obstacle=tall > ground, x0=x0, y0=y0, cell=cell
        )

    def sample(self, raster: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Bilinear look-up of one of the rasters at x, y: (...) [m]; the nearest edge's outside."""
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
        """Value of the nearest cell of a raster at x, y: (...) [m]; the nearest edge's outside."""
        ny, nx = raster.shape
        i = np.clip(np.rint((x - self.x0) / self.cell).astype(np.intp), 0, nx - 1)
        j = np.clip(np.rint((y - self.y0) / self.cell).astype(np.intp), 0, ny - 1)
        return raster[j, i]

    def contains(self, x: float, y: float) -> bool:
        """Whether x, y [m] lies on the rasters, edges included."""
        ny, nx = self.drive.shape
        return self.x0 <= x <= self.x0 + (nx - 1) * self.cell and self.y0 <= y <= self.y0 + (ny - 1) * self.cell


def split_rocks(scene: Scene, obstacle_height: float) -> tuple[np.ndarray, np.ndarray]:
    """Indices of the rocks in the scene's fine square that can be driven over, and of those that block.

    Rocks of less than SMALLEST_ROCK are left out of both. obstacle_height: exposed [m].
    """
    rocks, (x0, y0, x1, y1) = scene.rocks, scene.terrain.fine.bounds
    x, y, reach = rocks.centre[:, 0], rocks.centre[:, 1], rocks.diameter
    near = (x > x0 - reach) & (x < x1 + reach) & (y > y0 - reach) & (y < y1 + reach) & (reach >= SMALLEST_ROCK)
    tall = rocks.height >= obstacle_height
    return np.flatnonzero(near & ~tall), np.flatnonzero(near & tall)


def coarse_faces(rocks: Rocks, members: np.ndarray) -> np.ndarray:
    """(F, 3) faces of some rocks on fewer of their vertices, for collision.

    An icosphere's first vertices are those of its coarser levels, so the coarser faces thin a rock out.
    Rocks of other topology keep all theirs.
    """
    faces, rock = rocks.faces, rocks.face_rock
    out = []
    keys = np.asarray(members, dtype=rock.dtype)  # another dtype would make searchsorted copy all of `rock`
    starts, ends = np.searchsorted(rock, keys), np.searchsorted(rock, keys, side="right")
    for member, start, end in zip(members, starts, ends):
        level = 1 if rocks.diameter[member] < 0.2 else 2
        own, template = faces[start:end], icosphere(level)[1]
        if len(own) > len(template) and _is_icosphere(own):
            own = template + own.min()
        out.append(own)
    return np.concatenate(out) if out else np.zeros((0, 3), np.int32)


def _is_icosphere(faces: np.ndarray) -> bool:
    level = round(np.log2(max(len(faces), 20) / 20) / 2)
    if len(faces) != 20 * 4**level:
        return False
    return bool(np.array_equal(faces - faces.min(), icosphere(level)[1]))


def _rock_tops(rocks: Rocks, members: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(len(y), len(x)) highest rock surface over each node, -inf where there is none: vertical rays from above."""
    out = np.full((len(y), len(x)), -np.inf)
    if len(members) == 0:
        return out
    used, index = np.unique(coarse_faces(rocks, members), return_inverse=True)
    vertices = rocks.vertices[used]
    near = np.zeros(out.shape, dtype=np.uint8)  # rays are shot only within the rocks' bounding circles
    cell = x[1] - x[0]
    radius = 1.5 * rocks.diameter[members] / cell + 1
    at = np.rint((rocks.centre[members, :2] - (x[0], y[0])) / cell).astype(int)
    for centre, r in zip(at.tolist(), radius):
        cv2.circle(near, centre, int(np.ceil(r)), 1, thickness=-1)
    row, column = np.nonzero(near)
    above = float(vertices[:, 2].max()) + 1.0
    origins = np.stack([x[column], y[row], np.full(len(row), above)], axis=1)
    face, below = TriangleRays(vertices, index.reshape(-1, 3)).meet(origins, np.broadcast_to([0, 0, -1], origins.shape))
    found = face >= 0
    out[row[found], column[found]] = above - below[found]
    return out
