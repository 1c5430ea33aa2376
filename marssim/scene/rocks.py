"""The rocks of a scene as one mesh: their number, sizes, places and shapes.

Sizes follow the law of Golombek and Rapp (golombek.py); placement.py finds the places and shapes.py the shapes. The law
counts areas as seen from above. Three corrections keep them:

- Burial: a partly buried rock may show less than its widest section. Each rock is widened until the outline of its part
  above ground has the area of the drawn diameter.
- Slope: rocks are sheared with the plane of the ground under them, so that a slope does not bury more of them.
- Overlap: rocks lie beside each other, also in a cluster. The largest is placed first.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from marssim.scene.golombek import MAX_DIAMETER, draw_diameters, number_density
from marssim.scene.placement import place
from marssim.scene.shapes import FAMILIES, LEVELS, VARIANTS, icosphere, shape_library

__all__ = ["FAMILIES", "RockConfig", "Rocks", "build_rocks", "icosphere"]

STAND = 0.4  # largest |x| and |y| of a camera, in half sides of the fine square
MOST = 65_534  # most rocks that the 16 bits of a dataset's surface.png can number, besides sky and ground
SURE = 6.0  # standard deviations by which the expected number of rocks stays below MOST
NEAREST = 1.6  # [m] distance at which a camera is assumed to see the rocks around it
LEVEL_ANGLES = (0.03, 0.1, 0.25, 0.8)  # [rad] angular diameters at which a rock gets the next level of detail
# smallest rocks by distance from the middle: (half sides of the fine square, least diameter [m]) out to there
SMALLEST = ((0.75, 0.05), (1.0, 0.08), (2.5, 0.25), (np.inf, 0.6))
MIN_HEIGHT_RATIO, MAX_HEIGHT_RATIO = 0.15, 1.0  # height above ground over diameter
FLATNESS = np.array([1.2, 0.5, 1.1])  # relative height over diameter of each of FAMILIES: slabs are flat
KEPT_OFF = 0.1  # [m] diameter of the smallest rocks that clear discs keep out


@dataclass(frozen=True)
class RockConfig:
    """The rocks: how many lie on the ground, and what they look like."""

    k: float = 0.033
    """Share of the ground that rocks of any size cover, 0 to 0.4 (k of Golombek's law): Utopia has 0.033, Viking 2
    0.15."""
    min_diameter: float = 0.03
    """Diameter of the smallest rocks [m], near the middle where the cameras stand. Farther out, only larger ones are
    drawn."""
    cluster: float = 0.3
    """Share of the rocks that lie beside a larger one, 0 to 1."""
    height_ratio: float = 0.5
    """Mean height of the rocks above ground over their diameter, 0.1 to 1."""
    buried: tuple[float, float] = (0.1, 0.45)
    """Share of a rock's height that is below ground, LOW HIGH, 0 to 0.5. Each rock draws its own."""
    families: tuple[float, float, float] = (0.45, 0.25, 0.3)
    """Relative numbers of angular, slabby and rounded rocks: three shares in any unit."""
    albedo: float = 0.72
    """Mean brightness of the rocks over that of the ground, 0.2 to 1.5."""

    def __post_init__(self) -> None:
        if not 0 <= self.k <= 0.4:
            raise ValueError(f"k must lie in [0, 0.4], got {self.k}")
        if not 0.01 <= self.min_diameter < MAX_DIAMETER:
            raise ValueError(f"min_diameter must lie in [0.01, {MAX_DIAMETER}), got {self.min_diameter}")
        if not 0 <= self.cluster <= 1:
            raise ValueError(f"cluster must lie in [0, 1], got {self.cluster}")
        if not 0.1 <= self.height_ratio <= 1:
            raise ValueError(f"height_ratio must lie in [0.1, 1], got {self.height_ratio}")
        if not 0 <= self.buried[0] <= self.buried[1] <= 0.5:
            raise ValueError(f"buried must be a range within [0, 0.5], got {self.buried}")
        shares = self.families
        if len(shares) != len(FAMILIES) or not min(shares) >= 0 or not 0 < sum(shares) < np.inf:
            raise ValueError(f"families needs {len(FAMILIES)} shares that are not all zero, got {self.families}")
        if not 0.2 <= self.albedo <= 1.5:
            raise ValueError(f"albedo must lie in [0.2, 1.5], got {self.albedo}")


@dataclass(frozen=True)
class Rocks:
    """All rocks of a scene as one mesh: N rocks, V vertices, F faces, in the world frame [m].

    Attributes:
        centre: (N, 3) the point that each rock is star-shaped about [m].
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


def outline_points(
    rocks: Rocks, which: np.ndarray, height_at: Callable[[np.ndarray, np.ndarray], np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Return points whose convex hulls, seen from above, are the outlines of some rocks above ground.

    The points are the mesh's vertices above ground and the crossings of its edges with the ground.

    Args:
        rocks: All rocks.
        which: (M,) indices of the rocks.
        height_at: Function of x, y [m] that returns the height of the ground [m].

    Returns:
        (P, 2) x, y [m], unordered and with repetitions; and (P,) the position in `which` of each point's rock.
    """
    position = np.full(len(rocks), -1)
    position[which] = np.arange(len(which))
    owner = position[rocks.face_rock]
    faces, owner = rocks.faces[owner >= 0], owner[owner >= 0]
    corners = rocks.vertices[faces]
    above = corners[..., 2] - height_at(corners[..., 0], corners[..., 1])
    points, owners = [np.zeros((0, 2))], [np.zeros(0, owner.dtype)]
    for i, j in ((0, 1), (1, 2), (2, 0)):
        exposed = above[:, i] > 0
        cut = exposed != (above[:, j] > 0)  # the edge crosses the ground
        share = (above[cut, i] / (above[cut, i] - above[cut, j]))[:, None]
        points += [corners[exposed, i, :2], (1 - share) * corners[cut, i, :2] + share * corners[cut, j, :2]]
        owners += [owner[exposed], owner[cut]]
    return np.concatenate(points), np.concatenate(owners)


def reach_above_ground(
    rocks: Rocks, which: np.ndarray, height_at: Callable[[np.ndarray, np.ndarray], np.ndarray]
) -> np.ndarray:
    """Return how far some rocks reach sideways from their centres above ground.

    A rock of diameter D is no disc: its mesh reaches farther than D / 2.

    Args:
        rocks: All rocks.
        which: (M,) indices of the rocks.
        height_at: Function of x, y [m] that returns the height of the ground [m].

    Returns:
        (M,) horizontal reach [m]; 0 for a rock that is below ground.
    """
    points, owner = outline_points(rocks, which, height_at)
    out = np.zeros(len(which))
    np.maximum.at(out, owner, np.hypot(*(points - rocks.centre[which][owner, :2]).T))
    return out


def detail_level(diameter: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """Return the icosphere level of each rock, from the largest angle D / distance under which a camera may see it.

    Args:
        diameter: (N,) diameters [m].
        distance: (N,) least distances to a camera [m].

    Returns:
        (N,) int levels.
    """
    return np.digitize(np.asarray(diameter) / np.maximum(distance, NEAREST), LEVEL_ANGLES)


def build_rocks(
    config: RockConfig, half: float, horizon: float,
    height_at: Callable[[np.ndarray, np.ndarray], np.ndarray], rng: np.random.Generator,
    clear: tuple[tuple[float, float, float], ...] = (),
) -> Rocks:  # fmt: skip
    """Draw the rocks of a scene.

    Where cameras stand and a little around, the size law holds from min_diameter on; in the rest of the fine square
    from 0.08 m at the latest. Farther out it holds from the size that a camera in the square sees as a few pixels.

    Args:
        config: Number and shape of the rocks.
        half: Half the side of the finely gridded square [m].
        horizon: Half the side of the whole scene [m].
        height_at: Function of x, y [m] that returns the height of the ground [m].
        rng: Random generator.
        clear: Discs (x, y, radius) [m] that rocks of diameter KEPT_OFF and more stay out of. A rock counts as the disc
            of its diameter, so a corner of it may reach into a clear disc.

    Raises:
        ValueError: There are more rocks than a dataset can number.
    """
    diameter, xy = _scatter(config, half, horizon, rng)
    free = np.ones(len(diameter), dtype=bool)
    for x, y, radius in clear:
        free &= (np.hypot(xy[:, 0] - x, xy[:, 1] - y) > radius + diameter / 2) | (diameter < KEPT_OFF)
    diameter, xy = diameter[free], xy[free]
    away = np.abs(xy).max(axis=1, initial=0) - STAND * half
    level = detail_level(diameter, away + NEAREST)
    order = np.argsort(-level, kind="stable")  # rocks of one level are built together, and face_rock must ascend
    diameter, xy, level = diameter[order], xy[order], level[order]
    n = len(diameter)

    shares = np.array(config.families) / sum(config.families)
    family = rng.choice(len(FAMILIES), n, p=shares)
    # scaled so that the mean over the mixture of families is height_ratio
    ratio = config.height_ratio * FLATNESS[family] / (shares @ FLATNESS) * rng.lognormal(-0.03, 0.25, n)
    height = diameter * np.clip(ratio, MIN_HEIGHT_RATIO, MAX_HEIGHT_RATIO)
    buried = rng.uniform(*config.buried, n)
    variant = rng.integers(0, VARIANTS, n)
    yaw, stretch = rng.uniform(0, 2 * np.pi, n), np.sqrt(rng.uniform(0.65, 1.0, n))
    albedo = config.albedo * np.clip(rng.normal(1, 0.3, n), 0.45, 1.8)
    extent = height / (1 - buried)
    ground, slope = ground_plane(xy, diameter, height_at)

    centre = np.empty((n, 3))
    vertices, faces, face_rock, normals = [], [], [], []
    offset = 0
    for detail in range(LEVELS - 1, -1, -1):
        members = np.flatnonzero(level == detail)
        if len(members) == 0:
            continue
        shapes = shape_library(detail)
        shape = shapes.index(family[members], variant[members])
        size = diameter[members] * np.sqrt(np.pi / 4 / shapes.exposed_outline(shape, buried[members]))
        linear = _stretches(size, extent[members], yaw[members], stretch[members], slope[members])
        base = np.column_stack([xy[members], ground[members] - extent[members] * buried[members]])
        world = shapes.vertices[shape] @ linear.swapaxes(1, 2) + base[:, None]
        centre[members] = base
        centre[members, 2] += extent[members] * shapes.middle[shape]
        normal = shapes.normals[shape] @ np.linalg.inv(linear)
        normal /= np.sqrt(np.einsum("nvi,nvi->nv", normal, normal))[..., None]
        count = world.shape[1]
        index = shapes.faces[None] + (offset + np.arange(len(members), dtype=np.int32) * count)[:, None, None]
        offset += len(members) * count
        vertices.append(world.reshape(-1, 3))
        normals.append(normal.reshape(-1, 3))
        faces.append(index.reshape(-1, 3))
        face_rock.append(np.repeat(members.astype(np.int32), len(shapes.faces)))
    if not vertices:
        empty = np.zeros((0, 3))
        return Rocks(centre, diameter, height, albedo, empty, empty.astype(np.int32), np.zeros(0, np.int32), empty)
    return Rocks(
        centre=centre, diameter=diameter, height=height, albedo=albedo, vertices=np.concatenate(vertices),
        faces=np.ascontiguousarray(np.concatenate(faces), dtype=np.int32), face_rock=np.concatenate(face_rock),
        vertex_normals=np.concatenate(normals),
    )  # fmt: skip


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


def _scatter(
    config: RockConfig, half: float, horizon: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Draw the diameters (N,) and positions (N, 2) of all rocks [m], in square rings with a least diameter each."""
    rings, inner, expected = [], 0.0, 0.0
    near = min(STAND * half + 4.0, half)  # pebbles farther from a camera are smaller than a few pixels
    for reach, smallest in ((near, 0.0), *((ring * half, least) for ring, least in SMALLEST)):
        outer = min(reach, horizon)
        if outer > inner:
            rings.append((inner, outer, max(smallest, config.min_diameter)))
            expected += float(number_density(np.array(rings[-1][2]), config.k)) * 4 * (outer**2 - inner**2)
            inner = outer
    if (number := expected + SURE * np.sqrt(expected)) > MOST:  # so the first scene fails, and not just a later one
        raise ValueError(
            f"a scene can hold {MOST} rocks, but {number:.0f} may be drawn; choose a smaller `rocks.k` or `size`, or a "
            f"larger `rocks.min_diameter`"
        )
    diameters = [draw_diameters(config.k, least, 4 * (outer**2 - inner**2), rng) for inner, outer, least in rings]
    inners, outers = (np.repeat([ring[i] for ring in rings], [len(d) for d in diameters]) for i in (0, 1))
    diameter = np.concatenate(diameters)
    return diameter, place(diameter, inners, outers, config.cluster, rng)


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
