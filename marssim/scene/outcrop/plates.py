"""Plates of bedrock as bodies: an outline, a plane as top, and sides that are worn, chipped and undercut."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from marssim.scene.rocks.mesh import Rocks
from marssim.scene.rocks.shape_library import vertex_normals

POINTS = (8, 14, 32)  # points of an outline at each level of detail
BEVELLED = (False, True, True)  # whether the edge of the top is worn at each level
TOP_RINGS = ((), (), (0.6,))  # rings inside the top at each level, over the plate's size
ROUGH_SHARE = 0.35  # roughness of the top over the width of its bevel


@dataclass(frozen=True)
class Plates:
    """N plates of one level of detail, with outlines of P points.

    Attributes:
        outline: (N, P, 2) outline of the top seen from above, counter-clockwise [m].
        plane: (N, 3) z0, east, north: the top has the height z0 + east x + north y [m].
        thickness: (N,) vertical distance from the top to the bottom [m].
        undercut: (N,) how far the bottom lies inside the outline, over the plate's radius.
        bevel: (N,) width of the worn edge of the top [m].
        exposed: (N,) height of the highest edge above the ground [m]; of a bed, that of what it
            lies on and its own thickness.
        diameter: (N,) diameter of the disc with the area of the part that shows above the ground [m].
        middle: (N, 2) centroid of that part [m].
        albedo: (N,) brightness relative to the ground.
        level: Level of detail.
    """

    outline: np.ndarray
    plane: np.ndarray
    thickness: np.ndarray
    undercut: np.ndarray
    bevel: np.ndarray
    exposed: np.ndarray
    diameter: np.ndarray
    middle: np.ndarray
    albedo: np.ndarray
    level: int

    def __len__(self) -> int:
        return len(self.outline)

    def chosen(self, which: np.ndarray) -> Plates:
        """Return some of the plates. which: indices, or (N,) bool."""
        arrays = {f.name: getattr(self, f.name)[which] for f in fields(self) if f.name != "level"}
        return Plates(**arrays, level=self.level)

    def top_at(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return the height [m] of each plate's plane at x, y (N, ...) [m]."""
        z0, east, north = (self.plane[:, i].reshape(-1, *[1] * (np.ndim(x) - 1)) for i in range(3))
        return np.asarray(z0 + east * x + north * y)


def outside(parts: list[Plates], clear: tuple[tuple[float, float, float], ...]) -> list[Plates]:
    """Return the plates that stay out of clear discs (x, y, radius) [m], each taken as the disc of its diameter."""
    for x, y, radius in clear:
        parts = [p.chosen(np.hypot(*(p.middle - (x, y)).T) > radius + p.diameter / 2) for p in parts]
    return parts


def nearest(parts: list[Plates], most: int) -> list[Plates]:
    """Return the plates without those that are farthest from the scene's middle, so that at most `most` are left."""
    away = [np.hypot(*part.middle.T) for part in parts]
    if sum(map(len, parts)) <= most:
        return parts
    farthest = np.sort(np.concatenate(away))[most]
    return [part.chosen(distance < farthest) for part, distance in zip(parts, away)]


def plate_bodies(plates: Plates, rng: np.random.Generator) -> Rocks:
    """Return plates as bodies, in their order.

    A body has from bottom to top: a ring inside the outline, a ring on the outline, the rim of the top where the bevel
    ends, and rings inside the top that are a little uneven. It is closed.

    Args:
        plates: The plates.
        rng: Random generator.
    """
    count, points = plates.outline.shape[:2]
    vertices = _rings(plates, rng)
    edges = 2 if BEVELLED[plates.level] else 1
    sides, top = _faces(points, edges, len(TOP_RINGS[plates.level]))
    normals = vertex_normals(vertices, top)
    normals[:, : edges * points] = vertex_normals(vertices, sides)[:, : edges * points]
    faces = np.concatenate([sides, top])
    x, y = plates.middle.T
    centre = np.column_stack([x, y, plates.top_at(x, y) - plates.thickness / 2])
    index = faces[None] + (np.arange(count, dtype=np.int32) * vertices.shape[1])[:, None, None]
    return Rocks(
        centre=centre, diameter=plates.diameter, height=plates.exposed, albedo=plates.albedo,
        vertices=vertices.reshape(-1, 3), faces=index.reshape(-1, 3).astype(np.int32),
        face_rock=np.repeat(np.arange(count, dtype=np.int32), len(faces)), vertex_normals=normals.reshape(-1, 3),
    )  # fmt: skip


def _rings(plates: Plates, rng: np.random.Generator) -> np.ndarray:
    """Return the vertices (N, V, 3) of plates, ring by ring; see plate_bodies."""
    count, points = plates.outline.shape[:2]
    middle = plates.outline.mean(axis=1, keepdims=True)
    arm = plates.outline - middle
    radius = np.hypot(arm[..., 0], arm[..., 1]).mean(axis=1)[:, None, None]
    bevel = np.minimum(plates.bevel, 0.3 * plates.thickness)[:, None]
    worn = bevel * rng.uniform(0.4, 1.6, (count, points))
    cut = plates.undercut[:, None] * rng.uniform(0.3, 1.7, (count, points))
    flat, below = [arm * (1 - cut[..., None]), arm], [plates.thickness[:, None] * np.ones((1, points)), 0 * worn]
    if BEVELLED[plates.level]:
        flat.append(arm * (1 - np.minimum(worn[..., None] / radius, 0.3)))
        below[1:] = [worn, 0 * worn]
    rim = flat[-1]
    for share in TOP_RINGS[plates.level]:
        flat.append(rim * share * rng.uniform(0.9, 1.1, (count, points, 1)))
        below.append(ROUGH_SHARE * bevel * rng.uniform(-1, 1, (count, points)))
    flat.append(np.zeros((count, 1, 2)))
    below.append(ROUGH_SHARE * bevel * rng.uniform(-1, 1, (count, 1)))
    xy = middle + np.concatenate(flat, axis=1)
    z = plates.top_at(xy[..., 0], xy[..., 1]) - np.concatenate(below, axis=1)
    return np.concatenate([xy, z[..., None]], axis=2)


def _faces(points: int, edges: int, rings: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the faces (F, 3) of the bottom and of `edges` bands, the sides and the bevel; and those of the top."""
    around = np.arange(points)
    onward = (around + 1) % points
    bottom = np.stack([np.zeros(points - 2, int), around[2:], around[1:-1]], axis=1)
    bands = [_band(around + k * points, onward + k * points, points) for k in range(edges + rings)]
    last = (edges + rings) * points
    fan = np.stack([around + last, onward + last, np.full(points, last + points)], axis=1)
    return np.concatenate([bottom, *bands[:edges]]), np.concatenate([*bands[edges:], fan])


def _band(around: np.ndarray, onward: np.ndarray, points: int) -> np.ndarray:
    """Return the triangles between a ring and the next one above or inside it."""
    first = np.stack([around, onward, onward + points], axis=1)
    second = np.stack([around, onward + points, around + points], axis=1)
    return np.stack([first, second], axis=1).reshape(-1, 3)
