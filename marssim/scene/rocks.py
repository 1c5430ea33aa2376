"""Rocks: how many, how large, where, and of what shape, as one mesh.

Sizes follow Golombek and Rapp's law (golombek.py), positions placement.py, shapes shapes.py. The law speaks of what is
seen from above, so three things are corrected for:

- Burial. A rock that is partly below ground may show less than its widest section. Each is widened so that the outline
  of the part above ground is that of the diameter that was drawn for it.
- Slope. Rocks are sheared with the plane of the ground under them, so that a slope buries no more of them.
- Overlap. Rocks are put down beside each other, the largest first; also those of a cluster.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from marssim.scene.golombek import MAX_DIAMETER, draw_diameters, number_density
from marssim.scene.placement import place
from marssim.scene.shapes import FAMILIES, LEVELS, VARIANTS, icosphere, shape_library

__all__ = ["FAMILIES", "RockConfig", "Rocks", "build_rocks", "icosphere"]

STAND = 0.4  # of the half side of the fine square: along x and y, cameras stand that far from the middle at most
MOST = 65_534  # rocks that the 16 bits of a dataset's surface.png can tell apart, beside sky and ground
SURE = 6.0  # standard deviations by which the number that is expected stays below that
NEAREST = 1.6  # [m] distance from which rocks among the cameras are taken to be seen
LEVEL_ANGLES = (0.03, 0.1, 0.25, 0.8)  # [rad] seen diameter from which a rock gets the next level of detail
SMALLEST = (
    (0.75, 0.05),
    (1.0, 0.08),
    (2.5, 0.25),
    (np.inf, 0.6),
)  # least diameter [m] out to that many half sides of the square
MIN_HEIGHT_RATIO, MAX_HEIGHT_RATIO = 0.15, 1.0
FLATNESS = np.array([1.2, 0.5, 1.1])  # height over diameter of FAMILIES, beside each other: slabs are flat
KEPT_OFF = 0.1  # [m] diameter of rocks from which on places that shall be clear are kept clear of them


@dataclass(frozen=True)
class RockConfig:
    """How many rocks lie on the ground, and what they look like."""

    k: float = 0.033
    """share of the ground that rocks of any size cover, 0 to 0.4 (Golombek's k: Utopia .033, Viking 2 .15)"""
    min_diameter: float = 0.03
    """smallest rocks drawn [m], near the middle where cameras stand; farther out only larger ones are drawn"""
    cluster: float = 0.3
    """share of the rocks that lie beside a larger one, 0 to 1"""
    height_ratio: float = 0.5
    """mean height above ground over diameter"""
    buried: tuple[float, float] = (0.1, 0.45)
    """share of a rock's height that is below ground, LOW HIGH, each rock draws its own, 0 to 0.5"""
    families: tuple[float, float, float] = (0.45, 0.25, 0.3)
    """how many rocks are angular, slabby and rounded: three shares in any unit"""
    albedo: float = 0.72
    """mean brightness of the rocks, 1 for that of the ground"""

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
    """All rocks of a scene as one mesh. N rocks, V vertices, F faces; world frame, metres.

    centre: (N, 3) the point each rock is star-shaped about. diameter: (N,) of the disc whose area is the rock's outline
    above ground, seen from above. height: (N,) exposed, above the plane of the ground under the rock. albedo: (N,)
    relative to the ground. vertices: (V, 3) float64; faces: (F, 3) int32, outward; face_rock: (F,) int32 rock of each
    face, ascending. vertex_normals: (V, 3) unit, for smooth shading only.
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
    """Points whose convex hulls, seen from above, hold what the rocks `which` (M,) show above ground, and no more.

    Of the mesh: corners above ground, and where edges go into it. height_at(x, y): ground [m]. Returns (P, 2) x, y [m],
    in no order and many more than once, and (P,) the places in `which` of their rocks.
    """
    place = np.full(len(rocks), -1)
    place[which] = np.arange(len(which))
    of = place[rocks.face_rock]
    faces, of = rocks.faces[of >= 0], of[of >= 0]
    corners = rocks.vertices[faces]
    above = corners[..., 2] - height_at(corners[..., 0], corners[..., 1])
    points, owners = [np.zeros((0, 2))], [np.zeros(0, of.dtype)]
    for i, j in ((0, 1), (1, 2), (2, 0)):
        seen = above[:, i] > 0
        cut = seen != (above[:, j] > 0)  # where an edge goes into the ground
        share = (above[cut, i] / (above[cut, i] - above[cut, j]))[:, None]
        points += [corners[seen, i, :2], (1 - share) * corners[cut, i, :2] + share * corners[cut, j, :2]]
        owners += [of[seen], of[cut]]
    return np.concatenate(points), np.concatenate(owners)


def reach_above_ground(
    rocks: Rocks, which: np.ndarray, height_at: Callable[[np.ndarray, np.ndarray], np.ndarray]
) -> np.ndarray:
    """(M,) [m]: how far, sideways from its centre, each of the rocks `which` (M,) reaches above ground; 0 if nowhere.

    Of the mesh: a rock of diameter D is no disc, and reaches farther than D / 2. height_at(x, y): ground [m].
    """
    points, of = outline_points(rocks, which, height_at)
    out = np.zeros(len(which))
    np.maximum.at(out, of, np.hypot(*(points - rocks.centre[which][of, :2]).T))
    return out


def detail_level(diameter: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """Icosphere level of each rock: by the angle D / distance under which it is seen at closest."""
    return np.digitize(np.asarray(diameter) / np.maximum(distance, NEAREST), LEVEL_ANGLES)


def build_rocks(
    config: RockConfig, half: float, horizon: float,
    height_at: Callable[[np.ndarray, np.ndarray], np.ndarray], rng: np.random.Generator,
    clear: tuple[tuple[float, float, float], ...] = (),
) -> Rocks:  # fmt: skip
    """Draw the rocks of a scene.

    half: half the side of the finely gridded square; horizon: half the side of all [m]. height_at(x, y): ground [m].
    clear: discs (x, y, radius) [m] that outline discs of rocks of KEPT_OFF and more keep off; rocks are not round, so
    that corners may reach into them. The law holds from min_diameter on where cameras stand and a little around, from
    0.08 m at the latest in the square, and farther out only from the size on that a camera inside would see as a few
    pixels. Raises ValueError for more rocks than a dataset can tell apart.
    """
    diameter, xy = _scatter(config, half, horizon, rng)
    free = np.ones(len(diameter), dtype=bool)
    for x, y, radius in clear:
        free &= (np.hypot(xy[:, 0] - x, xy[:, 1] - y) > radius + diameter / 2) | (diameter < KEPT_OFF)
    diameter, xy = diameter[free], xy[free]
    away = np.abs(xy).max(axis=1, initial=0) - STAND * half
    level = detail_level(diameter, away + NEAREST)
    order = np.argsort(-level, kind="stable")  # rocks of one level are built at once, and faces shall ascend by rock
    diameter, xy, level = diameter[order], xy[order], level[order]
    n = len(diameter)

    shares = np.array(config.families) / sum(config.families)
    family = rng.choice(len(FAMILIES), n, p=shares)
    # the mean over the mixture of families is height_ratio
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
    """(N, 3, 3) linear maps from the library's shapes to rocks.

    size (N,) [m] of a shape's unit along x and y, extent (N,) [m] of its height, which is 1; yaw (N,) [rad]; stretch
    (N,): short over long axis is its square; slope (N, 2) of the ground, with which the rock is sheared.
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
    """Diameters (N,) and positions (N, 2) of all rocks: square rings, each with its own least diameter."""
    rings, inner, expected = [], 0.0, 0.0
    near = min(STAND * half + 4.0, half)  # pebbles farther from a camera are smaller than a few pixels
    for reach, smallest in ((near, 0.0), *((ring * half, least) for ring, least in SMALLEST)):
        outer = min(reach, horizon)
        if outer > inner:
            rings.append((inner, outer, max(smallest, config.min_diameter)))
            expected += float(number_density(np.array(rings[-1][2]), config.k)) * 4 * (outer**2 - inner**2)
            inner = outer
    if (number := expected + SURE * np.sqrt(expected)) > MOST:  # told of the first scene rather than of a later one
        raise ValueError(
            f"a scene can hold {MOST} rocks, {number:.0f} may be drawn here; choose a smaller `rocks.k` or `size`, or "
            f"a larger `rocks.min_diameter`"
        )
    diameters = [draw_diameters(config.k, least, 4 * (outer**2 - inner**2), rng) for inner, outer, least in rings]
    inners, outers = (np.repeat([ring[i] for ring in rings], [len(d) for d in diameters]) for i in (0, 1))
    diameter = np.concatenate(diameters)
    return diameter, place(diameter, inners, outers, config.cluster, rng)


def ground_plane(
    xy: np.ndarray, diameter: np.ndarray, height_at: Callable[[np.ndarray, np.ndarray], np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Height (N,) and slope (N, 2) of the plane through the ground at four points under each rock."""
    step = 0.35 * diameter
    east, west = height_at(xy[:, 0] + step, xy[:, 1]), height_at(xy[:, 0] - step, xy[:, 1])
    north, south = height_at(xy[:, 0], xy[:, 1] + step), height_at(xy[:, 0], xy[:, 1] - step)
    slope = np.stack([east - west, north - south], axis=1) / np.maximum(2 * step, 1e-9)[:, None]
    return (east + west + north + south) / 4, slope
