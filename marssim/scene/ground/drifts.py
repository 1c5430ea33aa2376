"""Sand that the wind has banked against rocks and slabs: mounds at their feet, tails in their lee, and moats.

They are heights on the ground, so that depth, normals, light and shadows have them. A mound follows the outline of its
body, is higher on one side than on the other, and thins out over a few of its heights, below the angle of repose. Under
the body the sand goes on, where nobody sees it, so that narrow mounds are smooth, too. Low bodies have no tails and no
moats. Those that are smaller than the grid can carry have no sand.
"""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from marssim.base.compute.compiled import compiled
from marssim.scene.look import Look
from marssim.scene.outcrop.outcrop import KINDS
from marssim.scene.rocks.mesh import Rocks, ground_plane
from marssim.scene.scene import Scene

DIRECTIONS = 16  # directions in which outlines are measured
SMALLEST = 0.07  # [m] diameter of the smallest bodies with mounds
MOUND = (0.03, 0.35)  # greatest height of a mound over that of its rock, at an amount of 1
SLAB_MOUND = (0.1, 1.1)  # the same of slabs and ledges, which are lower
BARE_SHARE = 0.12  # share of the bodies without a mound, as those that lie on the ground
HIGHEST = 0.1  # [m] height of the highest mounds
SPREAD = (3.6, 8.0)  # width of a mound over its height: the slope at its top is at most 29 deg
NARROWEST = 0.045  # [m] width of the narrowest mounds
LEE = (-0.5, 0.9)  # how much higher a mound is in the lee than at the sides
UNEVEN = 0.35  # how much the height of a mound changes along the outline
LAPPED = 0.12  # [m] how far the sand laps over a slab's top
UNDER, OVER = 1.05, 1.0  # how much higher sand is under a rock and on a slab, as the root of it
TAIL_FROM = 0.12  # [m] height of the lowest rocks with tails
TAILED, TAIL = 0.7, (0.15, 0.45)  # share of these with a tail; its height over that of the rock, at an amount of 1
TAIL_LENGTH = (2.0, 4.5)  # length of tails, in diameters
TAIL_HIGHEST, TAIL_STEEPEST = 0.14, 0.4  # greatest height of tails [m], and over half the width of their rocks
MOAT_FROM = 0.15  # [m] height of the lowest rocks with moats
MOATED, MOAT = 0.4, (0.05, 0.16)  # share of these with a moat; its depth over the rock's height, at an amount of 1
MOAT_DEEPEST, MOAT_WIDTH = 0.03, (0.07, 0.14)  # [m]
FADE = 1.0  # [m] width of the strip along the border of the fine square in which drifts fade
ROW = ("mound", "width", "lee", "uneven", "phase", "lap", "most", "tail", "length", "moat", "moat_width", "radius")
DRIFT = np.dtype([(name, np.float64) for name in ROW])
EDGE = 8  # cells by which the grid of drifts reaches beyond the fine square
DRIFT_CELL = 0.045  # [m] largest spacing of the grid that carries drifts


@dataclass(frozen=True, eq=False)
class Drifts:
    """The drifts of a scene.

    Attributes:
        heights: (N, N) float32 heights over the ground [m], rows northward; below 0 in moats.
        start: x and y of the first node [m].
        cell: Spacing of the nodes [m].
    """

    heights: np.ndarray
    start: float
    cell: float


_of_scene: WeakKeyDictionary[Scene, Drifts] = WeakKeyDictionary()


def drifts_of(scene: Scene) -> Drifts:
    """Return the drifts of a scene, drawn at the first call for it.

    Their grid is that of the terrain's fine square, EDGE cells wider and halved until it is as fine as DRIFT_CELL.
    """
    if scene not in _of_scene:
        fine = scene.terrain.fine
        nodes, cell = len(fine.heights) + 2 * EDGE, fine.cell
        while cell > DRIFT_CELL:
            nodes, cell = 2 * nodes - 1, cell / 2
        start = fine.x0 - EDGE * fine.cell
        rng = np.random.default_rng((scene.look.texture_seed, 7))
        heights = drift_heights(scene, wind_direction(scene.look), start, cell, nodes, rng)
        _of_scene[scene] = Drifts(heights, start, cell)
    return _of_scene[scene]


def wind_direction(look: Look) -> tuple[float, float]:
    """Return the unit vector of the direction that the wind blows to, across the crests of its ripples."""
    rng = np.random.default_rng((look.texture_seed, 5))
    rng.random()  # what the renderer draws the wavelength of the ripples from, before their turn
    turn = rng.uniform(0, 2 * np.pi)
    return float(np.float32(np.cos(turn))), -float(np.float32(np.sin(turn)))


def drift_heights(
    scene: Scene, wind: tuple[float, float], start: float, cell: float, nodes: int, rng: np.random.Generator
) -> np.ndarray:
    """Draw the drifts of a scene.

    Args:
        scene: The scene. Its look says how much sand there is.
        wind: (2,) unit vector of the direction that the wind blows to.
        start: x and y of the first node of the grid [m].
        cell: Spacing of its nodes [m].
        nodes: N, its nodes along a side.
        rng: Random generator.

    Returns:
        (N, N) float32 heights over the ground [m], rows northward; below 0 in moats.
    """
    bodies, amount, half = scene.bodies, scene.look.drifts, scene.half
    out = np.zeros((nodes, nodes), dtype=np.float32)
    inside = (np.abs(bodies.centre[:, :2]) < half).all(axis=1) & (bodies.diameter > SMALLEST)
    inside[len(bodies) - scene.outcrop.count[KINDS.index("fragments")] :] = False
    chosen = np.flatnonzero(inside)
    if amount == 0 or len(chosen) == 0:
        return out
    ground, slope = ground_plane(bodies.centre[chosen, :2], bodies.diameter[chosen], scene.terrain.height_at)
    row = np.full(len(bodies), -1)
    row[chosen] = np.arange(len(chosen))
    angle = np.arange(DIRECTIONS) * 2 * np.pi / DIRECTIONS
    towards = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    middle = np.ascontiguousarray(bodies.centre[chosen, :2])
    reach = _reach(bodies.vertices, bodies.faces, bodies.face_rock, row, middle, ground, slope, towards)
    drifts = _drawn(bodies, chosen, chosen >= len(scene.rocks), amount, rng)
    _lay(drifts, middle, reach, towards, np.array(wind), start, cell, out)
    axis = np.abs(start + cell * np.arange(nodes))
    fade = np.clip((half - 0.2 - axis) / FADE, 0, 1).astype(np.float32)
    return out * np.minimum(fade, fade[:, None])


def _drawn(
    bodies: Rocks, chosen: np.ndarray, bedrock: np.ndarray, amount: float, rng: np.random.Generator
) -> np.ndarray:
    """Draw the drifts (N,) of type DRIFT of the chosen bodies. bedrock: (N,) bool, those that are slabs or ledges."""
    count, height, diameter = len(chosen), bodies.height[chosen], bodies.diameter[chosen]
    out = np.zeros(count, dtype=DRIFT)
    low, high = (np.where(bedrock, SLAB_MOUND[i], MOUND[i]) for i in (0, 1))
    share = np.where(rng.random(count) < BARE_SHARE, 0, rng.uniform(low, high))
    out["mound"] = np.minimum(amount * share * height, HIGHEST)
    out["width"] = np.maximum(out["mound"] * rng.uniform(*SPREAD, count), NARROWEST)
    out["lee"], out["uneven"] = rng.uniform(*LEE, count), rng.uniform(0, UNEVEN, count)
    out["phase"] = rng.uniform(0, 2 * np.pi, count)
    out["lap"], out["most"] = np.where(bedrock, LAPPED, np.inf), np.where(bedrock, OVER, UNDER)
    tail = amount * rng.uniform(*TAIL, count) * height * (rng.random(count) < TAILED)
    tail = np.minimum(tail, np.minimum(TAIL_HIGHEST, TAIL_STEEPEST * diameter / 2))
    out["tail"] = np.where(bedrock | (height < TAIL_FROM), 0, tail)
    out["length"] = rng.uniform(*TAIL_LENGTH, count) * diameter
    moat = amount * rng.uniform(*MOAT, count) * height * (rng.random(count) < MOATED)
    out["moat"] = np.where(bedrock | (height < MOAT_FROM), 0, np.minimum(moat, MOAT_DEEPEST))
    out["moat_width"], out["radius"] = rng.uniform(*MOAT_WIDTH, count), diameter / 2
    return out


@compiled
def _reach(vertices, faces, owner, row, middle, ground, slope, towards):
    """Return how far the parts of bodies above the ground reach from their middles in each direction (N, K) [m].

    Args:
        vertices, faces, owner: Of Rocks; owner is its face_rock.
        row: (bodies,) row of each body in what follows, negative for none.
        middle: (N, 2) middles of the bodies [m].
        ground: (N,) heights of the ground's planes there [m].
        slope: (N, 2) slopes of these planes.
        towards: (K, 2) unit vectors of the directions.
    """
    out = np.zeros((len(middle), len(towards)))
    for f in range(len(faces)):
        n = row[owner[f]]
        if n < 0:
            continue
        for side in range(3):
            a, b = faces[f, side], faces[f, (side + 1) % 3]
            ax, ay = vertices[a, 0] - middle[n, 0], vertices[a, 1] - middle[n, 1]
            bx, by = vertices[b, 0] - middle[n, 0], vertices[b, 1] - middle[n, 1]
            high = vertices[a, 2] - ground[n] - slope[n, 0] * ax - slope[n, 1] * ay
            other = vertices[b, 2] - ground[n] - slope[n, 0] * bx - slope[n, 1] * by
            if high < 0:
                if other <= 0:
                    continue
                share = high / (high - other)  # the edge leaves the ground here
                ax, ay = ax + share * (bx - ax), ay + share * (by - ay)
            for k in range(len(towards)):
                out[n, k] = max(out[n, k], ax * towards[k, 0] + ay * towards[k, 1])
    return out


@compiled
def _lay(drifts, middle, reach, towards, wind, start, cell, out):
    """Add drifts to the heights of a grid, `out`; where several meet, the highest and the deepest count most.

    Args:
        drifts: (N,) of type DRIFT.
        middle: (N, 2) middles of the bodies [m].
        reach: (N, K) of _reach.
        towards: (K, 2) its directions.
        wind: (2,) where the wind blows to.
        start, cell, out: Of drift_heights.
    """
    nodes = len(out)
    piled, scoured = np.zeros((nodes, nodes)), np.zeros((nodes, nodes))
    for n in range(len(drifts)):
        drift = drifts[n]
        if drift.mound == 0 and drift.tail == 0 and drift.moat == 0:
            continue
        beyond = max(drift.width, 3 * drift.moat_width)
        far = reach[n].max() + max(beyond, drift.length if drift.tail > 0 else 0.0)
        i0, i1 = int((middle[n, 0] - far - start) / cell), int((middle[n, 0] + far - start) / cell) + 1
        j0, j1 = int((middle[n, 1] - far - start) / cell), int((middle[n, 1] + far - start) / cell) + 1
        for j in range(max(j0, 0), min(j1 + 1, nodes)):
            for i in range(max(i0, 0), min(i1 + 1, nodes)):
                x, y = start + i * cell - middle[n, 0], start + j * cell - middle[n, 1]
                off = -1e9
                for k in range(len(towards)):
                    off = max(off, x * towards[k, 0] + y * towards[k, 1] - reach[n, k])
                is_mound = off < drift.width and off > -drift.lap
                if not is_mound and drift.tail <= 0 and drift.moat <= 0:
                    continue
                along, across = x * wind[0] + y * wind[1], y * wind[0] - x * wind[1]
                lee = along / max(np.hypot(x, y), 1e-6)
                height = 0.0
                if is_mound:
                    rest = min(1 - off / drift.width, drift.most)
                    swing = 1 + drift.lee * lee + drift.uneven * np.cos(3 * np.arctan2(y, x) + drift.phase)
                    swing *= 1 / (1 + abs(drift.lee) + drift.uneven)
                    lap = min(1 + off / drift.lap, 1.0)  # 1 under a rock
                    height = drift.mound * max(swing, 0.0) * rest * rest * lap * lap
                if drift.tail > 0 and along > 0:
                    rest = 1 - (along - drift.radius) / drift.length
                    if rest > 0:
                        side = 1 - abs(across) / (drift.radius * (0.25 + 0.75 * rest))
                        if side > 0:
                            height = max(height, drift.tail * min(rest, 1.2) ** 1.3 * side**1.2)
                piled[j, i] += height**3
                if drift.moat > 0:
                    apart = (off - 0.8 * drift.moat_width) / drift.moat_width
                    deep = drift.moat * np.exp(-apart * apart) * min(max(0.4 - 0.9 * lee, 0.0), 1.0)
                    scoured[j, i] = max(scoured[j, i], deep)
    for j in range(nodes):
        for i in range(nodes):
            out[j, i] = np.cbrt(piled[j, i]) - scoured[j, i]
