"""Stones of 5 to 80 mm on the ground: convex bodies in periodic tiles, hit exactly by rays.

A stone is an ellipsoid, cut by a few planes where it has broken, that is partly sunk into the ground. Each octave of
diameters fills a periodic grid of cells with stones that lie close together. A stone lies on the ground where the
ground's cover asks for more stones of its octave than the stone's rank, so that patches end between stones.
"""

from __future__ import annotations

import math
from functools import lru_cache, partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from marssim.base.compute.compiled import compiled
from marssim.base.compute.kept_arrays import kept_arrays

SIZES = (0.005, 0.01, 0.02, 0.04, 0.08)  # [m] bounds of the octaves of diameters
CELLS = 128  # cells along a side of each octave's grid; a cell is as wide as the octave's largest stone
PACKED = 0.62  # share of the ground that an octave covers where its stones lie as close as they can
TRIES = 40  # places tried per stone
TIGHT = 0.93  # least distance of two stones' centres, over the sum of their mean radii
SHAPES, PLANES = 64, 6  # shapes of stones, and planes that each may be cut by
NARROW = (0.62, 1.0)  # short over long axis
TALL = (0.3, 0.62)  # vertical over mean horizontal axis
SAND_STONES = 0.9  # share of the stones that sand buries
SUNK = (0.05, 0.8)  # depth of the middle below the ground, in vertical semi-axes
FIELDS = 13
X, Y, AX, AY, BX, BY, RISE, MIDDLE, REACH, SIZE, RANK, TONE, SHAPE = range(FIELDS)
TOPS = 255  # code of the largest height of an octave
ENTRY_RANK, ENTRY_X, ENTRY_Y, ENTRY_REACH = range(4)  # columns of Stones.entry
SIDE, TOP, EAST, NORTH, BARE, GRAVEL, PER_SIDE = range(7)  # columns of Stones.octave


class Stones(NamedTuple):
    """Stones of all octaves, as kernels take them. A stone's row holds, in the order of X to SHAPE:

    its centre in the tile x, y [m]; the rows AX AY and BX BY of the map from offsets [m] to the unit sphere; the
    inverse of the vertical semi-axis [1/m]; the height of the middle over the ground [m]; the horizontal reach [m]; the
    diameter [m]; its rank, 0 to 1; its tone, of unit variance; and its row of `planes`.

    Attributes:
        start: (octaves * (CELLS * CELLS + 1),) int32 first entry of each cell in `member`.
        member: (M,) int32 stones that reach into a cell, cell by cell, in the order of their ranks.
        entry: (M, 4) float32 of these: rank; place x, y from the cell's corner, and horizontal reach, in cells.
        stone: (N, FIELDS) float32.
        top: (octaves * (CELLS * CELLS + 1),) uint8 height over the ground of the highest stone that reaches into a
            cell, of those that lie somewhere in the scene: over the octave's, rounded up to 1 / TOPS; 0 for none.
        planes: (SHAPES, PLANES, 4) float32 unit normal and offset on the unit sphere; an offset of 1 cuts nothing.
        octave: (octaves, 7) float32: the largest diameter, which is the side of a cell [m]; the largest height above
            the ground [m]; the place x, y of the tile's corner in the world [m]; the shares of its stones that lie on
            bare ground and in gravel; and its cells per metre.
    """

    start: np.ndarray
    member: np.ndarray
    entry: np.ndarray
    stone: np.ndarray
    top: np.ndarray
    planes: np.ndarray
    octave: np.ndarray


def placed_stones(stones: Stones, octave: np.ndarray) -> Stones:
    """Return stones with another `octave`, which says where and how many of them lie, and with the `top` of these."""
    octave = octave.astype(np.float32)
    return stones._replace(octave=octave, top=_tops(stones.start, stones.member, stones.entry, stones.stone, octave))


@lru_cache(maxsize=4)
def draw_stones(seed: int) -> Stones:
    """Return the stones of all octaves, drawn or from a file. None of them lie in the scene; see `placed_stones`."""
    return Stones(**kept_arrays(_drawn_stones, f"stones{seed}", partial(_drawn_stones, seed)))


def _drawn_stones(seed: int) -> dict[str, np.ndarray]:
    """Draw the arrays of Stones."""
    rng = np.random.default_rng((seed, 21))
    rows, starts, members, places, first, entries = [], [], [], [], 0, 0
    for low, high in pairwise(SIZES):
        stone = _octave(low, high, rng)
        start, member, entry = _cells(stone, high)
        rows.append(stone)
        starts.append(start + entries)
        members.append(member + first)
        places.append(entry)
        first += len(stone)
        entries += len(member)
    stone = np.concatenate(rows)
    top = [float((1 / each[:, RISE] + each[:, MIDDLE]).max()) for each in rows]
    octave = np.zeros((len(rows), 7), dtype=np.float32)
    octave[:, SIDE], octave[:, TOP], octave[:, PER_SIDE] = SIZES[1:], top, 1 / np.array(SIZES[1:])
    stones = Stones(
        start=np.concatenate(starts).astype(np.int32), member=np.concatenate(members).astype(np.int32),
        entry=np.concatenate(places).astype(np.float32), stone=stone.astype(np.float32),
        top=np.zeros(sum(map(len, starts)), dtype=np.uint8), planes=_planes(rng), octave=octave,
    )  # fmt: skip
    return stones._asdict()


def _octave(low: float, high: float, rng: np.random.Generator) -> np.ndarray:
    """Draw stones (N, FIELDS) with diameters from low to high [m] in a periodic square of CELLS * high."""
    side = CELLS * high
    mean_square = (high**2 - low**2) / (2 * math.log(high / low))  # of diameters that are uniform in the logarithm
    count = int(1.3 * PACKED * side**2 / (np.pi / 4 * mean_square))
    diameter = np.sort(np.exp(rng.uniform(math.log(low), math.log(high), count)))[::-1].copy()
    x, y, placed = _pack(diameter, CELLS, high, rng.random((count, TRIES, 2), dtype=np.float32))
    diameter, x, y = diameter[placed], x[placed], y[placed]
    n = len(diameter)
    narrow, turn = np.sqrt(rng.uniform(*NARROW, n)), rng.uniform(0, np.pi, n)
    a, b = diameter / 2 / narrow, diameter / 2 * narrow
    c = diameter / 2 * rng.uniform(*TALL, n) * 1.6
    out = np.empty((n, FIELDS))
    out[:, X], out[:, Y] = x, y
    out[:, AX], out[:, AY] = np.cos(turn) / a, np.sin(turn) / a
    out[:, BX], out[:, BY] = -np.sin(turn) / b, np.cos(turn) / b
    out[:, RISE], out[:, MIDDLE] = 1 / c, -c * rng.uniform(*SUNK, n)
    out[:, REACH], out[:, SIZE] = a, diameter
    out[:, RANK], out[:, TONE] = rng.uniform(0, 1, n), rng.standard_normal(n)
    out[:, SHAPE] = rng.integers(0, SHAPES, n)
    return out


def _planes(rng: np.random.Generator) -> np.ndarray:
    """Draw the planes (SHAPES, PLANES, 4) that cut stones: from rounded ones, which few cut, to broken ones."""
    normal = rng.normal(size=(SHAPES, PLANES, 3)) * (1, 1, 0.8)
    normal[..., 2] = np.abs(normal[..., 2]) + 0.1
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    broken = rng.uniform(0, 1, (SHAPES, 1)) ** 0.45
    offset = np.where(rng.uniform(0, 1, (SHAPES, PLANES)) < broken, rng.uniform(0.5, 0.92, (SHAPES, PLANES)), 2.0)
    return np.concatenate([normal, offset[..., None]], axis=2).astype(np.float32)


@compiled
def _pack(diameter, cells, cell, draws):
    """Place discs (N,), largest first, at random in a periodic square so that they hardly overlap."""
    n, side = len(diameter), cells * cell
    x, y, placed = np.empty(n), np.empty(n), np.zeros(n, dtype=np.bool_)
    head, following = np.full(cells * cells, -1), np.full(n, -1)
    for k in range(n):
        for attempt in range(draws.shape[1]):
            px, py = side * draws[k, attempt, 0], side * draws[k, attempt, 1]
            ci, cj = min(int(px / cell), cells - 1), min(int(py / cell), cells - 1)
            free = True
            for dj in range(-1, 2):
                for di in range(-1, 2):
                    other = head[((cj + dj) % cells) * cells + (ci + di) % cells]
                    while other >= 0 and free:
                        dx, dy = abs(px - x[other]), abs(py - y[other])
                        dx, dy = min(dx, side - dx), min(dy, side - dy)
                        least = 0.5 * TIGHT * (diameter[k] + diameter[other])
                        free = dx * dx + dy * dy >= least * least
                        other = following[other]
                    if not free:
                        break
                if not free:
                    break
            if free:
                x[k], y[k], placed[k] = px, py, True
                at = cj * cells + ci
                following[k], head[at] = head[at], k
                break
    return x, y, placed


@compiled
def _tops(start, member, entry, stone, octave):
    """Return Stones.top."""
    out = np.zeros(len(start), dtype=np.uint8)
    for n in range(len(octave)):
        most = octave[n, BARE] + octave[n, GRAVEL]
        for at in range(n * (CELLS * CELLS + 1), (n + 1) * (CELLS * CELLS + 1) - 1):
            highest = np.float32(0)
            for k in range(start[at], start[at + 1]):
                if most <= 0 or entry[k, ENTRY_RANK] > most:
                    break
                m = member[k]
                highest = max(highest, np.float32(1) / stone[m, RISE] + stone[m, MIDDLE])
            out[at] = min(math.ceil(highest / octave[n, TOP] * (TOPS - 1e-3)), TOPS)
    return out


def _cells(stone: np.ndarray, cell: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the first entry of each cell (CELLS * CELLS + 1,), and `member` and `entry` of Stones."""
    low = np.floor((stone[:, [X, Y]] - stone[:, [REACH]]) / cell).astype(int)
    high = np.floor((stone[:, [X, Y]] + stone[:, [REACH]]) / cell).astype(int)
    where, who, entry = [], [], []
    for dj in range(4):
        for di in range(4):
            i, j = low[:, 0] + di, low[:, 1] + dj
            near_x = np.clip(stone[:, X], i * cell, (i + 1) * cell) - stone[:, X]
            near_y = np.clip(stone[:, Y], j * cell, (j + 1) * cell) - stone[:, Y]
            inside = (i <= high[:, 0]) & (j <= high[:, 1]) & (np.hypot(near_x, near_y) <= stone[:, REACH])
            where.append(((j % CELLS) * CELLS + i % CELLS)[inside])
            who.append(np.flatnonzero(inside))
            place = np.stack([stone[:, X] / cell - i, stone[:, Y] / cell - j, stone[:, REACH] / cell], axis=1)
            entry.append(np.column_stack([stone[:, RANK], place])[inside])
    cells, stones, entries = np.concatenate(where), np.concatenate(who), np.concatenate(entry)
    order = np.lexsort((stone[stones, RANK], cells))  # kernels stop at the first stone of too high a rank
    return np.searchsorted(cells[order], np.arange(CELLS * CELLS + 1)), stones[order], entries[order]
