"""Rocks: how many, how large, where, and of what shape.

Sizes follow Golombek and Rapp (1997): rocks of diameter D and more cover F_k(D) = k exp(-q D) of the ground, with
q = 1.79 + 0.152 / k. That is an area; the number that goes with it is N(>D) = (4 k q / pi) [exp(-q D) / D - q E1(q D)].
Shapes are star-shaped about their centre (one radius for each direction of an icosphere), so that the face behind a
surface point is found from its direction alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import trimesh
from scipy.spatial import ConvexHull, cKDTree
from scipy.special import exp1

FAMILIES = ("angular", "slabby", "rounded")
VARIANTS = 12  # shapes per family, level of detail and scene
MAX_DIAMETER = 2.5  # [m] larger rocks are not drawn


@dataclass(frozen=True)
class RockConfig:
    """Knobs of the rock population; lengths in metres."""

    k: float = 0.033  # share of the ground that rocks of any size cover
    min_diameter: float = 0.05  # within the finely gridded square; coarser outside
    cluster: float = 0.3  # share of rocks that lie near a larger one
    height_ratio: float = 0.5  # mean exposed height over diameter
    buried: tuple[float, float] = (0.1, 0.45)  # share of the vertical extent that is below ground
    families: tuple[float, float, float] = (0.45, 0.25, 0.3)  # shares of angular, slabby, rounded

    def __post_init__(self) -> None:
        if not 0 <= self.k <= 0.4:
            raise ValueError(f"k must lie in [0, 0.4], got {self.k}")
        if not 0.01 <= self.min_diameter < MAX_DIAMETER:
            raise ValueError(f"min_diameter must lie in [0.01, {MAX_DIAMETER}), got {self.min_diameter}")
        if not 0 <= self.buried[0] <= self.buried[1] <= 0.5:
            raise ValueError(f"buried must be a range within [0, 0.5], got {self.buried}")
        if len(self.families) != len(FAMILIES) or min(self.families) < 0 or sum(self.families) <= 0:
            raise ValueError(f"families needs {len(FAMILIES)} shares that are not all zero, got {self.families}")


@dataclass(frozen=True)
class Rocks:
    """All rocks of a scene as one mesh. N rocks, V vertices, F faces; world frame, metres.

    centre: (N, 3) the point each rock is star-shaped about. diameter: (N,) of the disc of equal outline seen from
    above. height: (N,) exposed, above the ground at the rock's middle. albedo: (N,) relative to the ground.
    vertices: (V, 3) float64; faces: (F, 3) int32, outward; face_rock: (F,) int32 rock of each face, ascending.
    vertex_normals: (V, 3) unit, for smooth shading only.
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


def decay(k: float) -> float:
    """q(k) [1/m] of Golombek and Rapp's exponential."""
    return 1.79 + 0.152 / k


def covered_area(diameter: np.ndarray, k: float) -> np.ndarray:
    """F_k(D): share of the ground covered by rocks of diameter D [m] and more."""
    return k * np.exp(-decay(k) * np.asarray(diameter)) if k > 0 else np.zeros_like(diameter)


def number_density(diameter: np.ndarray, k: float) -> np.ndarray:
    """N(>D): rocks of diameter D [m] and more per square metre."""
    d = np.asarray(diameter, dtype=float)
    if k == 0:
        return np.zeros_like(d)
    q = decay(k)
    return 4 * k * q / np.pi * (np.exp(-q * d) / d - q * exp1(q * d))


def draw_diameters(k: float, smallest: float, area: float, rng: np.random.Generator) -> np.ndarray:
    """Diameters [m], descending, of the rocks of at least `smallest` on `area` [m2]: a Poisson draw of the law."""
    grid = np.geomspace(smallest, MAX_DIAMETER, 400)
    number = number_density(grid, k) - number_density(np.array(MAX_DIAMETER), k)
    count = rng.poisson(number[0] * area)
    if count == 0:
        return np.zeros(0)
    level = rng.uniform(0, number[0], count)
    return np.sort(np.interp(level, number[::-1], grid[::-1]))[::-1]


@lru_cache(maxsize=8)
def icosphere(level: int) -> tuple[np.ndarray, np.ndarray]:
    """Unit directions (V, 3) and faces (F, 3) of an icosahedron subdivided `level` times (20 * 4^level faces)."""
    sphere = trimesh.creation.icosphere(subdivisions=level)
    return np.asarray(sphere.vertices, dtype=float), np.asarray(sphere.faces, dtype=np.int32)


def draw_shape(family: str, level: int, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """One rock on the icosphere of that level: outline of the area of a unit-diameter disc, z from 0 to 1.

    Returns (V, 3) vertices and the height z of the centre, which lies at x = y = 0.
    """
    u, _ = icosphere(level)
    r = np.ones(len(u))
    lumps = rng.normal(size=(7, 3))
    lumps /= np.linalg.norm(lumps, axis=1, keepdims=True)
    swell = rng.uniform(0.05, 0.22 if family == "rounded" else 0.12, 7)
    for direction, gain in zip(lumps, swell):
        r *= 1 + gain * np.exp(-3 * (1 - u @ direction)) - 0.3 * gain
    if family != "rounded":
        count = rng.integers(11, 20)
        planes = rng.normal(size=(count, 3)) * (1.0, 1.0, 1.4 if family == "slabby" else 1.0)
        planes /= np.linalg.norm(planes, axis=1, keepdims=True)
        offset = rng.uniform(0.45, 0.85, count)
        facing = u @ planes.T
        cut = np.where(facing > 0.05, offset / np.maximum(facing, 0.05), np.inf)
        r = np.minimum(r, cut.min(axis=1))
    if family == "slabby":  # a flat top
        top = np.quantile(u[:, 2] * r, 0.8)
        r = np.where(u[:, 2] * r > top, top / np.maximum(u[:, 2], 1e-9), r)
    r *= 1 + rng.normal(0, 0.012, len(u))
    v = u * r[:, None]
    stretch = rng.uniform(0.75, 1.0)
    v *= (1.0, stretch, 1.0)
    lean = rng.normal(0, 0.12, 2)
    v[:, :2] += v[:, 2:] * lean
    v[:, :2] *= np.sqrt(np.pi / 4 / ConvexHull(v[:, :2]).volume)  # in two dimensions `volume` is the area
    bottom, top = v[:, 2].min(), v[:, 2].max()
    v[:, 2] = (v[:, 2] - bottom) / (top - bottom)
    return v, float(-bottom / (top - bottom))


def place(diameter: np.ndarray, half: float, cluster: float, rng: np.random.Generator) -> np.ndarray:
    """(N, 2) positions in the square |x|, |y| <= half; rocks of 0.12 m and more do not overlap where they can avoid it.

    diameter: (N,) descending. A share `cluster` lies within a few diameters of an earlier, larger rock.
    """
    n = len(diameter)
    xy = rng.uniform(-half, half, (n, 2))
    if n > 1:
        parent = (rng.uniform(0, 1, n) * np.arange(n) * 0.3).astype(int)
        near = (rng.uniform(0, 1, n) < cluster) & (np.arange(n) > 0)
        reach = diameter[parent] * 0.6 + diameter * 0.6 + np.abs(rng.normal(0, 0.5 + diameter[parent]))
        angle = rng.uniform(0, 2 * np.pi, n)
        beside = xy[parent] + reach[:, None] * np.stack([np.cos(angle), np.sin(angle)], 1)
        xy = np.where(near[:, None] & (np.abs(beside) < half).all(1, keepdims=True), beside, xy)
    large = int(np.sum(diameter >= 0.12))
    for _ in range(8):
        clash = _overlapping(xy[:large], diameter[:large])
        if len(clash) == 0:
            break
        xy[clash] = rng.uniform(-half, half, (len(clash), 2))
    return xy


def _overlapping(xy: np.ndarray, diameter: np.ndarray) -> np.ndarray:
    """Indices of rocks that overlap a larger (earlier) one."""
    if len(xy) < 2:
        return np.zeros(0, dtype=int)
    pairs = cKDTree(xy).query_pairs(float(diameter[0]), output_type="ndarray")
    if len(pairs) == 0:
        return np.zeros(0, dtype=int)
    pairs = np.sort(pairs, axis=1)
    gap = np.linalg.norm(xy[pairs[:, 0]] - xy[pairs[:, 1]], axis=1)
    return np.unique(pairs[gap < 0.55 * (diameter[pairs[:, 0]] + diameter[pairs[:, 1]]), 1])


def detail_level(diameter: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """Icosphere level of each rock: by the angle D / distance under which it is seen at closest."""
    angle = np.asarray(diameter) / np.maximum(distance, 1.0)
    return np.digitize(angle, [0.02, 0.12, 0.45])


def build_rocks(
    config: RockConfig, half: float, horizon: float, height_at, rng: np.random.Generator, clear=()
) -> Rocks:
    """Draw the rocks of a scene.

    half: half the side of the finely gridded square; horizon: half the side of all [m]. height_at(x, y): ground [m].
    clear: discs (x, y, radius) [m] that stay free of rocks of 0.1 m and more. In the square the law holds from
    min_diameter on; outside only from the size on that a camera inside would see as a few pixels.
    """
    diameters, positions = [], []
    for inner, outer, smallest in (
        (0.0, half, config.min_diameter),
        (half, min(2.5 * half, horizon), max(0.25, config.min_diameter)),
        (min(2.5 * half, horizon), horizon, max(0.6, config.min_diameter)),
    ):
        d = draw_diameters(config.k, smallest, (2 * outer) ** 2, rng) if config.k > 0 and outer > inner else np.zeros(0)
        xy = place(d, outer, config.cluster, rng)
        ring = np.abs(xy).max(axis=1, initial=0) >= inner
        diameters.append(d[ring])
        positions.append(xy[ring])
    diameter, xy = np.concatenate(diameters), np.concatenate(positions)
    free = np.ones(len(diameter), dtype=bool)
    for x, y, radius in clear:
        free &= (np.hypot(xy[:, 0] - x, xy[:, 1] - y) > radius + diameter / 2) | (diameter < 0.1)
    diameter, xy = diameter[free], xy[free]
    n = len(diameter)

    family = rng.choice(len(FAMILIES), n, p=np.array(config.families) / sum(config.families))
    flatness = np.where(family == FAMILIES.index("slabby"), 0.6, 1.15)
    height = diameter * np.clip(config.height_ratio * flatness * rng.lognormal(0, 0.25, n), 0.15, 1.0)
    buried = rng.uniform(*config.buried, n)
    yaw = rng.uniform(0, 2 * np.pi, n)
    variant = rng.integers(0, VARIANTS, n)
    albedo = np.clip(rng.normal(0.72, 0.16, n), 0.35, 1.15)
    ground = height_at(xy[:, 0], xy[:, 1])
    outside = np.maximum(0, np.abs(xy).max(axis=1, initial=0) - half)
    level = detail_level(diameter, outside + 1.3)

    extent = height / (1 - buried)
    base = ground + height - extent
    c, s = np.cos(yaw) * diameter, np.sin(yaw) * diameter
    centre = np.empty((n, 3))
    vertices, faces, face_rock, normals = [], [], [], []
    offset = 0
    for detail in range(4):
        # drawn even if unused, so that the rocks of one level do not change the shapes of the others
        drawn = [draw_shape(name, detail, rng) for name in FAMILIES for _ in range(VARIANTS)]
        template = icosphere(detail)[1]
        members = np.flatnonzero(level == detail)
        if len(members) == 0:
            continue
        kind = family[members] * VARIANTS + variant[members]
        v = np.stack([shape for shape, _ in drawn])[kind]  # (members, V, 3)
        world = np.empty_like(v)
        cm, sm = c[members, None], s[members, None]
        world[..., 0] = cm * v[..., 0] - sm * v[..., 1] + xy[members, 0, None]
        world[..., 1] = sm * v[..., 0] + cm * v[..., 1] + xy[members, 1, None]
        world[..., 2] = extent[members, None] * v[..., 2] + base[members, None]
        centre[members, :2] = xy[members]
        centre[members, 2] = extent[members] * np.array([middle for _, middle in drawn])[kind] + base[members]
        count = v.shape[1]
        index = template[None] + (offset + np.arange(len(members), dtype=np.int32) * count)[:, None, None]
        offset += len(members) * count
        vertices.append(world.reshape(-1, 3))
        faces.append(index.reshape(-1, 3))
        face_rock.append(np.repeat(members, len(template)))
        normals.append(_vertex_normals(world, template).reshape(-1, 3))
    if not vertices:
        empty = np.zeros((0, 3))
        return Rocks(centre, diameter, height, albedo, empty, empty.astype(np.int32), np.zeros(0, np.int32), empty)
    all_faces, rock = np.concatenate(faces), np.concatenate(face_rock)
    order = np.argsort(rock, kind="stable")
    return Rocks(
        centre=centre, diameter=diameter, height=height, albedo=albedo, vertices=np.concatenate(vertices),
        faces=np.ascontiguousarray(all_faces[order], dtype=np.int32), face_rock=rock[order].astype(np.int32),
        vertex_normals=np.concatenate(normals),
    )  # fmt: skip


def _vertex_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(N, V, 3) unit normals of N meshes (N, V, 3) of one topology, weighted by area."""
    a, b, c = (vertices[:, faces[:, i]] for i in range(3))
    face = np.cross(b - a, c - a)
    out = np.zeros_like(vertices)
    for i in range(3):
        np.add.at(out.swapaxes(0, 1), faces[:, i], face.swapaxes(0, 1))
    return out / np.maximum(np.linalg.norm(out, axis=-1, keepdims=True), 1e-12)
