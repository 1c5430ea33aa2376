"""The library of rock shapes that all scenes stretch, turn, bury and scale, with the outlines that they show."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache, partial

import numpy as np

from marssim.base.compute.kept_arrays import kept_arrays
from marssim.scene.rocks.shapes import FAMILIES, LEVELS, draw_shape, icosphere

VARIANTS = 24  # shapes per family
# shapes per family at each level: fine ones take time, and few rocks need them
SHAPES_AT_LEVEL = dict(zip(LEVELS, (24, 24, 24, 24, 24, 10, 4)))
BURIAL = np.linspace(0, 0.75, 16)  # shares of the height below ground at which outlines are tabulated
RASTER = 36  # cells along a side of the square on which outlines are measured
SEED = 1997  # of the library


@dataclass(frozen=True)
class ShapeLibrary:
    """All shapes at one level of detail: M = families x SHAPES_AT_LEVEL[level] shapes of V vertices and F faces.

    Attributes:
        vertices: (M, V, 3), with z from 0 to 1.
        normals: (M, V, 3) unit normals at the vertices.
        middle: (M,) z of the centre, which lies at x = y = 0.
        faces: (F, 3) int32 faces of every shape, counter-clockwise seen from outside.
        outline: (M, len(BURIAL)) area, seen from above, of the part above ground when the share BURIAL of the height is
            below ground.
    """

    vertices: np.ndarray
    normals: np.ndarray
    middle: np.ndarray
    faces: np.ndarray
    outline: np.ndarray

    def index(self, family: np.ndarray, variant: np.ndarray) -> np.ndarray:
        """Return the (N,) shape of each rock of a family (N,) and variant (N,), both int."""
        each = len(self.vertices) // len(FAMILIES)
        return family * each + variant % each

    def exposed_outline(self, shape: np.ndarray, buried: np.ndarray) -> np.ndarray:
        """Return the area, seen from above, that shapes show above level ground.

        Args:
            shape: (N,) int shapes.
            buried: (N,) shares of their heights that lie below ground.

        Returns:
            (N,) areas, interpolated in the table.
        """
        at = np.clip(np.asarray(buried) / (BURIAL[1] - BURIAL[0]), 0, len(BURIAL) - 1)
        low = np.minimum(at.astype(int), len(BURIAL) - 2)
        part = at - low
        return (1 - part) * self.outline[shape, low] + part * self.outline[shape, low + 1]


@lru_cache(maxsize=len(LEVELS))
def shape_library(level: int) -> ShapeLibrary:
    """Return the shapes of every family, FAMILIES[0] first, at a level of detail."""
    return ShapeLibrary(**kept_arrays(draw_library, f"shapes{level}", partial(draw_library, level)))


def draw_library(level: int) -> dict[str, np.ndarray]:
    """Draw the shapes of a level, and return the fields of their ShapeLibrary."""
    drawn = [
        draw_shape(name, level, np.random.default_rng((SEED, n, variant)))
        for n, name in enumerate(FAMILIES)
        for variant in range(SHAPES_AT_LEVEL[level])
    ]
    vertices = np.stack([shape for shape, _ in drawn])
    faces = icosphere(level)[1]
    return {
        "vertices": vertices,
        "normals": vertex_normals(vertices, faces),
        "middle": np.array([middle for _, middle in drawn]),
        "faces": faces,
        "outline": outlines(vertices, faces),
    }


def outlines(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the area, seen from above, of the part of each mesh above z = BURIAL.

    It is counted on a raster of the highest surface over each cell's middle.

    Args:
        vertices: (M, V, 3), with z from 0 to 1.
        faces: (F, 3) faces of every mesh.

    Returns:
        (M, len(BURIAL)) areas.
    """
    shapes = len(vertices)
    low = vertices[..., :2].min(axis=1) - 1e-9
    step = (vertices[..., :2].max(axis=1) + 1e-9 - low) / RASTER
    scaled = np.concatenate([(vertices[..., :2] - low[:, None]) / step[:, None] - 0.5, vertices[..., 2:]], axis=-1)
    a, b, c = (scaled[:, faces[:, i]].reshape(-1, 3) for i in range(3))
    area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    up = np.flatnonzero(area > 0)  # the upward faces of a closed mesh cover all of its outline
    shape = np.repeat(np.arange(shapes), len(faces))[up]
    a, b, c, area = a[up], b[up], c[up], area[up]
    first = np.ceil(np.minimum(np.minimum(a, b), c)[:, :2]).astype(int)
    last = np.floor(np.maximum(np.maximum(a, b), c)[:, :2]).astype(int)
    size = np.maximum(last - first + 1, 0)
    count = size[:, 0] * size[:, 1]
    owner = np.repeat(np.arange(len(count)), count)
    local = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    i = first[owner, 0] + local % np.maximum(size[owner, 0], 1)
    j = first[owner, 1] + local // np.maximum(size[owner, 0], 1)
    a, b, c, area = a[owner], b[owner], c[owner], area[owner]
    p = ((b[:, 0] - i) * (c[:, 1] - j) - (b[:, 1] - j) * (c[:, 0] - i)) / area
    q = ((c[:, 0] - i) * (a[:, 1] - j) - (c[:, 1] - j) * (a[:, 0] - i)) / area
    inside = (p >= 0) & (q >= 0) & (p + q <= 1)
    z = p * a[:, 2] + q * b[:, 2] + (1 - p - q) * c[:, 2]
    top = np.full((shapes, RASTER, RASTER), -np.inf)
    np.maximum.at(top, (shape[owner[inside]], j[inside], i[inside]), z[inside])
    cell = step[:, 0] * step[:, 1]
    return np.stack([(top > level).sum(axis=(1, 2)) * cell for level in BURIAL], axis=1)


def vertex_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the (M, V, 3) unit vertex normals of M meshes with the same faces, weighted by area."""
    a, b, c = (vertices[:, faces[:, i]] for i in range(3))
    face = np.cross(b - a, c - a)
    out = np.zeros_like(vertices)
    for i in range(3):
        np.add.at(out.swapaxes(0, 1), faces[:, i], face.swapaxes(0, 1))
    return out / np.maximum(np.linalg.norm(out, axis=-1, keepdims=True), 1e-12)
