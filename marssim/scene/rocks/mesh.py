"""The rocks of a scene as one mesh: their number, sizes, places and shapes.

Sizes follow the law of Golombek and Rapp (golombek.py); placement.py finds the places and shapes.py the shapes. The law
counts areas as seen from above. Three corrections keep them:

- Burial: a partly buried rock may show less than its widest section. Each rock is widened until the outline of its part
  above ground has the area of the drawn diameter.
- Slope: rocks are sheared with the plane of the ground under them, so that a slope does not bury more of them.
- Overlap: rocks lie beside each other, also in a cluster. The largest is placed first.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields

import numpy as np

from marssim.scene.rocks.population import RockConfig, RockPopulation, draw_population
from marssim.scene.rocks.shape_library import ShapeLibrary, shape_library
from marssim.scene.rocks.shapes import LEVELS

LiftAt = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Rocks:
    """All rocks of a scene, or other bodies on its ground, as one mesh: N bodies, V vertices, F faces, in metres.

    Attributes:
        centre: (N, 3) the point that each rock is star-shaped about; of other bodies, a point in their middle [m].
        diameter: (N,) diameter of the disc with the area of the rock's outline above ground, seen from above [m].
        height: (N,) exposed height above the plane of the ground under the rock [m].
        albedo: (N,) brightness relative to the ground.
        vertices: (V, 3) float64 [m].
        faces: (F, 3) int32, counter-clockwise seen from outside.
        face_rock: (F,) int32 rock of each face, ascending.
        vertex_normals: (V, 3) unit normals, for smooth shading only.
    """

    centre: np.ndarray
    diameter: np.ndarray
    height: np.ndarray
    albedo: np.ndarray
    vertices: np.ndarray
    faces: np.ndarray
    face_rock: np.ndarray
    vertex_normals: np.ndarray

    def __len__(self) -> int:
        return len(self.diameter)


def no_bodies() -> Rocks:
    """Return no bodies."""
    none, points = np.zeros(0), np.zeros((0, 3))
    return Rocks(points, none, none, none, points, np.zeros((0, 3), np.int32), np.zeros(0, np.int32), points)


def joined_bodies(parts: Sequence[Rocks]) -> Rocks:
    """Return the bodies of all parts, in their order, as one mesh."""
    bodies, vertices = (np.cumsum([0, *counts]) for counts in zip(*((len(p), len(p.vertices)) for p in parts)))
    arrays = {f.name: np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Rocks)}
    faces = [part.faces + np.int32(start) for part, start in zip(parts, vertices)]
    owner = [part.face_rock + np.int32(start) for part, start in zip(parts, bodies)]
    return Rocks(**{**arrays, "faces": np.concatenate(faces), "face_rock": np.concatenate(owner)})


def build_rocks(
    config: RockConfig, half: float, horizon: float,
    height_at: Callable[[np.ndarray, np.ndarray], np.ndarray], rng: np.random.Generator,
    clear: tuple[tuple[float, float, float], ...] = (), lift: LiftAt | None = None,
) -> Rocks:  # fmt: skip
    """Draw the rocks of a scene, and mesh them on the ground.

    A rock on bedrock is raised to it. It keeps its place and its size, so that the size law holds. Beside bedrock, it
    stands on the lowest of what lies under it, and the bedrock's edge may reach into it.

    Args:
        config: Number and shape of the rocks.
        half: Half the side of the finely gridded square [m].
        horizon: Half the side of the whole scene [m].
        height_at: Function of x, y [m] that returns the height of the ground [m].
        rng: Random generator.
        clear: Discs (x, y, radius) [m] that stay free of rocks; see draw_population.
        lift: Function of x, y and the height of the ground [m] that returns how far bedrock stands above it [m].

    Raises:
        ValueError: There are more rocks than a dataset can number.
    """
    drawn = draw_population(config, half, horizon, rng, clear)
    return mesh_population(drawn, height_at, lift)


def mesh_population(
    drawn: RockPopulation, height_at: Callable[[np.ndarray, np.ndarray], np.ndarray], lift: LiftAt | None = None
) -> Rocks:
    """Mesh rocks on the planes of the ground under them.

    Args:
        drawn: The rocks.
        height_at, lift: See build_rocks.
    """
    ground, slope = ground_plane(drawn.xy, drawn.diameter, height_at)
    if lift is not None:
        ground = ground + least_lift(drawn.xy, drawn.diameter, height_at, lift)
    centre = np.empty((len(drawn.diameter), 3))
    vertices, normals = [np.zeros((0, 3))], [np.zeros((0, 3))]
    faces, face_rock = [np.zeros((0, 3), np.int32)], [np.zeros(0, np.int32)]
    offset = 0
    for detail in reversed(LEVELS):
        members = np.flatnonzero(drawn.level == detail)
        if len(members) == 0:
            continue
        shapes = shape_library(detail)
        world, normal, centre[members] = _place_bodies(shapes, drawn, members, ground[members], slope[members])
        count = world.shape[1]
        index = shapes.faces[None] + (offset + np.arange(len(members), dtype=np.int32) * count)[:, None, None]
        offset += len(members) * count
        vertices.append(world.reshape(-1, 3))
        normals.append(normal.reshape(-1, 3))
        faces.append(index.reshape(-1, 3))
        face_rock.append(np.repeat(members.astype(np.int32), len(shapes.faces)))
    return Rocks(
        centre=centre,
        diameter=drawn.diameter,
        height=drawn.height,
        albedo=drawn.albedo,
        vertices=np.concatenate(vertices),
        faces=np.ascontiguousarray(np.concatenate(faces), dtype=np.int32),
        face_rock=np.concatenate(face_rock),
        vertex_normals=np.concatenate(normals),
    )


def _place_bodies(
    shapes: ShapeLibrary, drawn: RockPopulation, members: np.ndarray, ground: np.ndarray, slope: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Place the bodies of some rocks of one level of detail in the world.

    Args:
        shapes: The shapes of the level.
        drawn: All rocks of the scene.
        members: (M,) indices of the rocks.
        ground: (M,) height of the ground under each [m].
        slope: (M, 2) slope of the ground under each.

    Returns:
        (M, V, 3) vertices [m], (M, V, 3) unit normals at the vertices, and (M, 3) centres [m].
    """
    buried = drawn.buried[members]
    extent = drawn.height[members] / (1 - buried)
    shape = shapes.index(drawn.family[members], drawn.variant[members])
    size = drawn.diameter[members] * np.sqrt(np.pi / 4 / shapes.exposed_outline(shape, buried))
    linear = _stretches(size, extent, drawn.yaw[members], drawn.stretch[members], slope)
    base = np.column_stack([drawn.xy[members], ground - extent * buried])
    vertices = shapes.vertices[shape] @ linear.swapaxes(1, 2) + base[:, None]
    normals = shapes.normals[shape] @ np.linalg.inv(linear)
    normals /= np.sqrt(np.einsum("nvi,nvi->nv", normals, normals))[..., None]
    base[:, 2] += extent * shapes.middle[shape]
    return vertices, normals, base


def _stretches(
    size: np.ndarray, extent: np.ndarray, yaw: np.ndarray, stretch: np.ndarray, slope: np.ndarray
) -> np.ndarray:
    """Return the (N, 3, 3) linear maps from the library's shapes to rocks.

    Args:
        size: (N,) length of a shape's unit along x and y [m].
        extent: (N,) height of the rock [m]; that of a shape is 1.
        yaw: (N,) turn about the vertical [rad].
        stretch: (N,) square root of the ratio of the short to the long axis.
        slope: (N, 2) slope of the ground, with which the rock is sheared.
    """
    c, s = size * np.cos(yaw), size * np.sin(yaw)
    long, short = 1 / stretch, stretch
    out = np.zeros((len(size), 3, 3))
    out[:, 0, 0], out[:, 0, 1] = c * long, -s * short
    out[:, 1, 0], out[:, 1, 1] = s * long, c * short
    out[:, 2, :2] = np.einsum("ni,nij->nj", slope, out[:, :2, :2])
    out[:, 2, 2] = extent
    return out


def least_lift(
    xy: np.ndarray, diameter: np.ndarray, height_at: Callable[[np.ndarray, np.ndarray], np.ndarray], lift: LiftAt
) -> np.ndarray:
    """Return how far bedrock raises each rock [m], (N,): the least of the rock's middle and four points around it.

    The arguments are those of ground_plane and build_rocks.
    """
    x, y = xy[:, 0], xy[:, 1]
    out = lift(x, y, height_at(x, y))
    on = np.flatnonzero(out)
    step = 0.35 * diameter[on, None] * np.array([[1, -1, 0, 0]])
    x, y = xy[on, :1] + step, xy[on, 1:] + step[:, [2, 3, 0, 1]]
    out[on] = np.minimum(out[on], lift(x, y, height_at(x, y)).min(axis=1))
    return out


def ground_plane(
    xy: np.ndarray, diameter: np.ndarray, height_at: Callable[[np.ndarray, np.ndarray], np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the plane of the ground under each rock, from four points.

    Args:
        xy: (N, 2) positions [m].
        diameter: (N,) diameters [m].
        height_at: Function of x, y [m] that returns the height of the ground [m].

    Returns:
        (N,) heights of the plane at the positions [m], and (N, 2) its slopes dz/dx, dz/dy.
    """
    step = 0.35 * diameter
    east, west = height_at(xy[:, 0] + step, xy[:, 1]), height_at(xy[:, 0] - step, xy[:, 1])
    north, south = height_at(xy[:, 0], xy[:, 1] + step), height_at(xy[:, 0], xy[:, 1] - step)
    slope = np.stack([east - west, north - south], axis=1) / np.maximum(2 * step, 1e-9)[:, None]
    return (east + west + north + south) / 4, slope
