"""The shapes of rocks: angular blocks, layered slabs and rounded cobbles.

A rock is a polytope of fracture planes with more or less worn edges. Its radius along a direction u is that of the
p-norm of the planes' gauges, r(u) = (sum max(u.n_i / d_i, 0)^p)^(-1/p); p = inf gives the polytope itself. Lumps and
roughness are added along the radius. So every rock is star-shaped about its centre, and the direction of a surface
point determines the face behind it. The directions are those of an icosphere. They slide onto edges and corners of the
polytope that are near, so that edges run straight even on a rock of few triangles.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

FAMILIES = ("angular", "slabby", "rounded")
LEVELS = range(-2, 5)  # levels of detail: 4, 8, 20, 80, 320, 1280, 5120 faces
BEDS = 32  # beds of a rock, which weather back by different amounts


@lru_cache(maxsize=10)
def icosphere(level: int) -> tuple[np.ndarray, np.ndarray]:
    """Return an icosahedron subdivided `level` times: unit directions (V, 3) and 20 * 4^level faces (F, 3).

    Level -1 is an octahedron and level -2 a tetrahedron.
    """
    if level < 0:
        return _tetrahedron() if level == -2 else _octahedron()
    import trimesh  # not at the top: it takes a third of a second, and most processes read their shapes from a file

    sphere = trimesh.creation.icosphere(subdivisions=level)
    return np.asarray(sphere.vertices, dtype=float), np.asarray(sphere.faces, dtype=np.int32)


def _tetrahedron() -> tuple[np.ndarray, np.ndarray]:
    corners = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / np.sqrt(3)
    return corners, np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]], dtype=np.int32)


def _octahedron() -> tuple[np.ndarray, np.ndarray]:
    corners = np.concatenate([np.eye(3), -np.eye(3)])
    upper = [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2]]
    return corners, np.array([*upper, *([b, a, 5] for a, b, _ in upper)], dtype=np.int32)


def draw_shape(family: str, level: int, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """Draw one rock. The same state of rng gives the same rock at every level.

    Args:
        family: One of FAMILIES.
        level: Level of the icosphere, one of LEVELS.
        rng: Random generator.

    Returns:
        (V, 3) vertices with z from 0 to 1, and the height z of the centre, which lies at x = y = 0.
    """
    directions, faces = icosphere(level)
    normal, offset, wear = _fracture_planes(family, rng)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    lean = rng.normal(0, 0.15, 2)
    u = snap(directions @ turn.T, faces, normal, offset)
    gauge = np.maximum(u @ (normal / offset[:, None]).T, 0)
    largest = gauge.max(axis=1, keepdims=True)
    r = 1 / (largest[:, 0] * ((gauge / largest) ** wear).sum(axis=1) ** (1 / wear))
    v = u * (r * (1 + _roughness(family, u * r[:, None], level, rng)))[:, None]
    v[:, :2] += v[:, 2:] * lean
    bottom, top = v[:, 2].min(), v[:, 2].max()
    v[:, 2] = (v[:, 2] - bottom) / (top - bottom)
    return v, float(-bottom / (top - bottom))


def _fracture_planes(family: str, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, float]:
    """Draw a rock's fracture planes: unit normals (P, 3), offsets (P,), and the exponent p of its worn edges."""
    if family == "slabby":
        count = int(rng.integers(5, 8))
        azimuth = (np.arange(count) + rng.uniform(-0.33, 0.33, count)) * 2 * np.pi / count
        sides = np.stack([np.cos(azimuth), np.sin(azimuth), rng.normal(0, 0.22, count)], axis=1)
        beds = np.array([[0, 0, 1.0], [0, 0, -1.0]]) + rng.normal(0, 0.07, (2, 3))
        chips = rng.normal(size=(3, 3)) * (1, 1, 0.8)
        normal = np.concatenate([beds, sides, chips])
        offset = np.concatenate([rng.uniform(0.55, 0.7, 2), rng.uniform(0.7, 1.0, count), rng.uniform(0.85, 1.05, 3)])
        wear = rng.uniform(22, 50)
    elif family == "angular":
        triad = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        blocks = np.concatenate([triad, -triad]) + rng.normal(0, 0.16, (6, 3))
        count = int(rng.integers(5, 10))
        normal = np.concatenate([blocks, rng.normal(size=(count, 3))])
        offset = np.concatenate([rng.uniform(0.55, 0.85, 6), rng.uniform(0.68, 0.98, count)])
        wear = rng.uniform(18, 60)
    else:
        count = int(rng.integers(12, 18))
        normal = rng.normal(size=(count, 3))
        normal = np.concatenate([normal, np.eye(3), -np.eye(3)])
        offset = np.concatenate([rng.uniform(0.72, 1.0, count), rng.uniform(0.8, 1.0, 6)])
        wear = rng.uniform(6, 11)
    return normal / np.linalg.norm(normal, axis=1, keepdims=True), offset, float(wear)


def _roughness(family: str, points: np.ndarray, level: int, rng: np.random.Generator) -> np.ndarray:
    """Return the (V,) relative change of the radius: lumps, ridges and dents, scars of chips, ledges of beds.

    Only what the level's triangles can show is added. Everything is drawn at every level, so that the levels agree.
    """
    spacing = 1.1 / 2**level
    out = np.zeros(len(points))
    strength = {"angular": 0.07, "slabby": 0.06, "rounded": 0.045}[family]
    patch = _waves(points, 1.1, rng)  # some sides are fresh and smooth, others weathered
    worn = 0.55 + 0.45 * np.tanh(1.5 * patch)
    for octave, wavelength in enumerate((1.6, 0.8, 0.4, 0.2, 0.1)):
        swing = _waves(points, wavelength, rng)
        if wavelength < 2 * spacing:
            continue
        if family != "rounded" and octave >= 1:
            swing = 0.8 - 1.6 * np.abs(swing) / (1 + np.abs(swing))  # ridges and dents, as of broken stone
        out += strength * 0.75**octave * swing * (worn if octave >= 2 else 1)
    out -= _scars(family, points, 2 * spacing, rng)
    layers, start, bedded, backs = rng.uniform(5, 13), rng.uniform(0, 1), rng.random(), rng.uniform(-1, 1, BEDS)
    tilt = np.append(rng.normal(0, 0.15 if family == "slabby" else 0.5, 2), 1.0)
    if (family == "slabby" or (family == "angular" and bedded < 0.6)) and level >= 2:  # beds weather back alternately
        across = points @ (tilt / np.linalg.norm(tilt))
        height = across * layers + start + 0.25 * patch
        ledge = np.floor(height)
        back = backs[ledge.astype(int) % BEDS]
        step = np.clip((height - ledge) * 6, 0, 1) * np.clip((1 - height + ledge) * 12, 0, 1)
        side = 1 - (across / np.linalg.norm(points, axis=1)) ** 2
        out += 0.05 * side * (step - 0.6) + 0.1 * side * back
    return np.maximum(out, -0.4)


def _waves(points: np.ndarray, wavelength: float, rng: np.random.Generator) -> np.ndarray:
    """Return (V,) smooth noise of about unit variance at points (V, 3)."""
    wave = rng.normal(size=(7, 3))
    wave *= 2 * np.pi / wavelength / np.linalg.norm(wave, axis=1, keepdims=True) * rng.uniform(0.7, 1.4, (7, 1))
    return np.asarray(np.sin(points @ wave.T + rng.uniform(0, 2 * np.pi, 7)).sum(axis=1) / np.sqrt(3.5))


def _scars(family: str, points: np.ndarray, least: float, rng: np.random.Generator) -> np.ndarray:
    """Return the (V,) share of the radius that broken-off chips took. Scars narrower than `least` are left out."""
    count = {"angular": 18, "slabby": 14, "rounded": 4}[family]
    reach = np.linalg.norm(points, axis=1)
    out = np.zeros(len(points))
    # each scar moves from a random direction to the farthest point near it: an edge or a corner
    where = rng.normal(size=(count, 3))
    where /= np.linalg.norm(where, axis=1, keepdims=True)
    size, depth = rng.uniform(0.15, 0.7, count), rng.uniform(0.25, 0.6, count)
    for direction, width, deep in zip(where, size, depth):
        if width < least:
            continue
        towards = points @ direction
        tip = points[np.argmax(towards - 0.6 * np.linalg.norm(points - towards[:, None] * direction, axis=1))]
        away = np.linalg.norm(points - tip, axis=1) / width
        # the scar is a bowl around the tip that broke off
        out = np.maximum(out, deep * width * np.clip(1 - away**2, 0, 1) / np.maximum(reach, 1e-9))
    return out


def snap(directions: np.ndarray, faces: np.ndarray, normal: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """Slide directions onto the edges and corners of the polytope {x: n_i . x <= d_i} that are near.

    No face flips or shrinks to a sliver: where one would, its vertices stay.

    Args:
        directions: (V, 3) unit vectors.
        faces: (F, 3) faces between them, counter-clockwise seen from outside.
        normal: (P, 3) unit normals n_i.
        offset: (P,) offsets d_i > 0.

    Returns:
        (V, 3) unit vectors.
    """
    corner = directions[faces]
    reach = 0.5 * np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2).mean()
    gauge = (directions @ normal.T) / offset
    near = np.argsort(-gauge, axis=1)[:, :3]
    point = directions / gauge[np.arange(len(gauge)), near[:, 0], None]
    length = np.linalg.norm(point, axis=1)
    target = point.copy()
    moved = np.full(len(point), np.inf)
    for count in (2, 3):
        planes, rest = normal[near[:, :count]], offset[near[:, :count]]
        gram = planes @ planes.swapaxes(1, 2)
        sound = np.abs(np.linalg.det(gram)) > 0.05
        gram[~sound] = np.eye(count)
        away = rest - np.einsum("nij,nj->ni", planes, point)
        meeting = point + np.einsum("nij,ni->nj", planes, np.linalg.solve(gram, away[..., None])[..., 0])
        gap = np.linalg.norm(meeting - point, axis=1)
        on_polytope = ((meeting @ normal.T) / offset).max(axis=1) < 1 + 1e-6
        good = np.flatnonzero(sound & on_polytope & (gap < (reach if count == 2 else 1.5 * reach) * length))
        if count == 3:  # only the nearest vertex may take a corner
            key = np.sort(near[good], axis=1) @ (1, len(normal), len(normal) ** 2)
            order = np.lexsort((gap[good], key))
            good = good[order[np.unique(key[order], return_index=True)[1]]]
        target[good], moved[good] = meeting[good], gap[good]
    out = target / np.linalg.norm(target, axis=1, keepdims=True)
    least = 0.2 * np.linalg.det(corner)
    for _ in range(20):
        bad = faces[np.linalg.det(out[faces]) < least]
        if len(bad) == 0:
            return out
        shift = np.where(np.isfinite(moved), moved, -1)[bad]
        back = np.unique(bad[np.arange(len(bad)), shift.argmax(axis=1)])
        out[back], moved[back] = directions[back], np.inf
    return directions.copy()
