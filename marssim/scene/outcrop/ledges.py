"""Ledges: steps of layered bedrock that run along the contours of the ground, and the blocks that broke off them.

A ledge faces downhill. Its beds lie on each other and dip into the hill, so that their tops end under the sand behind.
Joints cut each bed into blocks. A bed whose front has weathered back leaves the one above it overhanging.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from marssim.scene.outcrop.config import OutcropConfig, Traits
from marssim.scene.outcrop.laying import worn_outlines
from marssim.scene.outcrop.plates import POINTS, Plates
from marssim.scene.outcrop.polygons import area_and_centroid, disc_diameter
from marssim.scene.outcrop.resting import Ground

REACH = 1.4  # half sides of the fine square, beyond which no ledge begins
STEP = 0.25  # [m] between the points of a ledge's line
SMOOTH = 1.5  # [m] distance over which the slope is taken that the line follows
LEVEL = 0.05  # slope below which the line follows the contour less
WANDER = 0.5  # [rad/m] how much the line turns beside the contour
BEDS = (2, 4)  # least and largest number of beds
BLOCK = (0.3, 1.1)  # [m] length of the blocks of a bed
ROW = (0.4, 0.9)  # [m] depth of the blocks of a bed
JOINT = 0.012  # [m] width of the joints
SETBACK = (0.02, 0.1)  # [m] how far the front of a bed lies behind that of the bed below
WEATHERED = 0.06  # [m] standard deviation of the fronts of blocks
DIP = np.tan(np.deg2rad((3.0, 8.0)))  # dip of the beds into the hill
DEEPEST = 2.2  # [m] distance behind the front in which the top ends under the sand
LOST = 0.12  # share of the blocks that broke off
ROOT = 0.15  # [m] depth of the lowest bed below the ground
FALLEN = 1.3  # blocks in front of a ledge, for each metre of it
FALLEN_SIZE = (0.12, 0.5)  # [m] their diameters
FALLEN_REACH = 0.6  # [m] mean distance from the ledge
FALLEN_TILT = np.tan(np.deg2rad(22))  # largest tilt
SHADE = 0.85  # brightness of ledges over that of slabs, which the wind keeps fresh
POLYGON = 6  # corners of a fallen block


@dataclass(frozen=True)
class LedgeLine:
    """Where a ledge runs: N points, STEP apart.

    Attributes:
        xy: (N, 2) points of its foot [m].
        out: (N, 2) unit vectors towards its front.
        level: (N,) smooth height of the ground along it [m].
        slope: Mean slope of the ground, uphill behind it.
        height: Height of the ledge [m].
    """

    xy: np.ndarray
    out: np.ndarray
    level: np.ndarray
    slope: float
    height: float

    def at(self, along: np.ndarray, behind: np.ndarray) -> np.ndarray:
        """Return the points (..., 2) at distances along the line and behind it (...) [m]."""
        x, y, u, v = self._values(along)
        return np.stack([x - u * behind, y - v * behind], axis=-1)

    def frame(self, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the level (N,) [m] and the unit vectors towards the front (N, 2) at distances along the line (N,)."""
        _, _, u, v = self._values(along)
        length = np.hypot(u, v)
        level = np.interp(along, STEP * np.arange(len(self.xy)), self.level)
        return level, np.stack([u / length, v / length], axis=-1)

    def _values(self, along: np.ndarray) -> list[np.ndarray]:
        axis = STEP * np.arange(len(self.xy))
        return [np.interp(along, axis, values) for values in (*self.xy.T, *self.out.T)]

    @property
    def length(self) -> float:
        """Length of the line [m]."""
        return STEP * (len(self.xy) - 1)


def draw_ledges(
    config: OutcropConfig, traits: Traits, half: float, horizon: float, height_at: Ground, rng: np.random.Generator
) -> list[Plates]:  # fmt: skip
    """Draw the ledges of a scene.

    Args:
        config: The settings, of which each ledge draws its height and its length.
        traits: What the scene drew.
        half: Half the side of the finely gridded square [m].
        horizon: Half the side of the whole scene [m].
        height_at: Function of x, y [m] that returns the height of the ground [m].
        rng: Random generator.

    Returns:
        The blocks of each ledge, and those that fell.
    """
    reach = min(REACH * half, horizon - 2)
    if reach <= 0:
        return []
    out, albedo = [], SHADE * traits.brightness
    for _ in range(rng.poisson(traits.ledges * (2 * reach) ** 2 / 1000)):
        line = _line(config, reach, height_at, rng)
        level = len(POINTS) - 1 if np.abs(line.xy).max(axis=1).min() < half else 1
        out += [_blocks(line, albedo, level, height_at, rng), _fallen(line, albedo, level, height_at, rng)]
    return out


def _line(config: OutcropConfig, reach: float, height_at: Ground, rng: np.random.Generator) -> LedgeLine:
    """Draw the line of a ledge: a contour of the ground, smoothed, that turns a little to both sides of it."""
    start, height = rng.uniform(-reach, reach, 2), rng.uniform(*config.ledge_height)
    number = int(rng.uniform(*config.ledge_length) / STEP) + 2
    wave = rng.uniform(0.4, 1.2), rng.uniform(0, 2 * np.pi)
    heading, _ = _contour(start, height_at)
    at, points = start, []
    for n in range(number):
        points.append(at)
        contour, slope = _contour(at, height_at)
        turn = (contour - heading + np.pi) % (2 * np.pi) - np.pi
        heading += np.clip(0.3 * min(1.0, slope / LEVEL) * turn, -STEP, STEP)
        heading += WANDER * STEP * np.sin(wave[0] * n * STEP + wave[1])
        at = at + STEP * np.array([np.cos(heading), np.sin(heading)])
    xy = np.array(points)
    along = np.gradient(xy, axis=0)
    out = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.hypot(*along.T)[:, None]
    behind, front = (height_at(*places.T) for places in (xy - out, xy))
    level = np.convolve(np.pad(front, 2, mode="edge"), np.ones(5) / 5, mode="valid")
    return LedgeLine(xy, out, level, float(np.mean(behind - front)), height)


def _contour(at: np.ndarray, height_at: Ground) -> tuple[float, float]:
    """Return the direction of the contour at a point (2,) [rad], with uphill to its right, and the slope there."""
    east, west, north, south = height_at(*(SMOOTH * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]]) + at).T)
    dx, dy = (east - west) / (2 * SMOOTH), (north - south) / (2 * SMOOTH)
    return float(np.arctan2(dx, -dy)), float(np.hypot(dx, dy))


def _blocks(line: LedgeLine, albedo: float, level: int, height_at: Ground, rng: np.random.Generator) -> Plates:
    """Return the blocks of a ledge that show."""
    beds = int(rng.integers(BEDS[0], BEDS[1] + 1))
    share = rng.uniform(0.5, 1.5, beds)
    tops = line.height * np.cumsum(share) / share.sum()
    dip = max(float(rng.uniform(*DIP)), line.height / DEEPEST - line.slope)
    back, cells = 0.0, []
    for bed in range(beds):
        back += rng.uniform(*SETBACK) - (0.08 if rng.random() < 0.3 else 0.0)
        depth = min(max((tops[bed] / max(dip + line.slope, 0.05)) + 0.3, 0.5), DEEPEST + 0.5)
        if bed < beds - 1:
            depth = min(depth, 0.7 + back)  # the bed above covers the rest
        thick = tops[bed] - (tops[bed - 1] if bed else -ROOT)
        cells += _cells(line.length, back, depth, bed == beds - 1, (bed, tops[bed], thick), rng)
    table = np.array(cells)
    along, behind = table[:, :4], table[:, 4:8]
    corners = line.at(along, behind)
    middle = along.mean(axis=1)
    level_at, out = line.frame(middle)
    taper = np.clip(1.5 * np.sin(np.pi * np.clip(middle / line.length, 0, 1)), 0, 1)
    number = np.full(len(table), 4)
    centre = area_and_centroid(corners, number)[1]
    shape = worn_outlines(corners, number, POINTS[level], 0.3, rng)
    foot = line.at(middle, np.zeros(len(middle)))
    gradient = dip * out + rng.normal(0, 0.012, (len(table), 2))
    z = level_at + table[:, 9] - (1 - taper) * line.height + rng.normal(0, 0.006, len(table))
    plane = np.column_stack([z - np.einsum("ni,ni->n", gradient, foot), gradient])
    return _shown(shape, plane, table[:, 10] + 0.02, centre, albedo, level, height_at, rng)


def _cells(
    length: float, back: float, depth: float, last: bool, bed: tuple[float, float, float], rng: np.random.Generator
) -> list[list[float]]:
    """Return the blocks of a bed: distances along and behind the line of four corners, and bed, top and thickness."""
    out, start = [], back
    row = 0
    while start < depth:
        end = start + rng.uniform(*ROW)
        left = -rng.uniform(0, 0.5)
        while left < length:
            right = left + rng.uniform(*BLOCK)
            front = start + (rng.normal(0, WEATHERED) if row == 0 else 0.0)
            lost = rng.random() < LOST and row == 0 and last
            skew = rng.normal(0, 0.06, 4)
            if not lost:
                along = [left + JOINT + skew[0], left + JOINT + skew[1], right + skew[1], right + skew[0]]
                behind = [front + skew[2], end - JOINT, end - JOINT, front + skew[3]]
                out.append([*along, *behind, *bed])
            left = right
        start, row = end, row + 1
    return out


def _fallen(line: LedgeLine, albedo: float, level: int, height_at: Ground, rng: np.random.Generator) -> Plates:
    """Return the blocks that lie in front of a ledge."""
    count = rng.poisson(FALLEN * line.length)
    diameter = FALLEN_SIZE[0] * (FALLEN_SIZE[1] / FALLEN_SIZE[0]) ** rng.random(count)
    along = rng.uniform(0, line.length, count)
    middle = line.at(along, -0.3 * diameter - rng.exponential(FALLEN_REACH, count))
    angle = (np.arange(POLYGON) + rng.uniform(-0.35, 0.35, (count, POLYGON))) * 2 * np.pi / POLYGON
    angle += rng.uniform(0, 2 * np.pi, (count, 1))
    radius = diameter[:, None] / 2 * rng.uniform(0.75, 1.2, (count, POLYGON))
    corners = middle[:, None] + radius[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    shape = worn_outlines(corners, np.full(count, POLYGON), POINTS[min(level, 1)], 0.2, rng)
    lean = FALLEN_TILT * rng.random(count)
    towards = rng.uniform(0, 2 * np.pi, count)
    gradient = lean[:, None] * np.stack([np.cos(towards), np.sin(towards)], axis=1)
    top = height_at(middle[:, 0], middle[:, 1]) + np.minimum(
        rng.uniform(0.15, 0.5, count) * diameter, 0.8 * line.height
    )
    plane = np.column_stack([top - np.einsum("ni,ni->n", gradient, middle), gradient])
    thickness = 0.8 * diameter
    return _shown(shape, plane, thickness, middle, albedo, min(level, 1), height_at, rng)


def _shown(
    shape: np.ndarray, plane: np.ndarray, thickness: np.ndarray, middle: np.ndarray, albedo: float, level: int,
    height_at: Ground, rng: np.random.Generator,
) -> Plates:  # fmt: skip
    """Return the blocks whose top is above the ground somewhere. middle: (N, 2) their middles [m]."""
    count, points = len(shape), shape.shape[1]
    x, y = shape[..., 0], shape[..., 1]
    above = (plane[:, :1] + plane[:, 1:2] * x + plane[:, 2:] * y - height_at(x, y)).max(axis=1, initial=-1)
    area = area_and_centroid(shape, np.full(count, points))[0]
    blocks = Plates(
        outline=shape, plane=plane, thickness=thickness, undercut=rng.uniform(0, 0.1, count),
        bevel=0.08 * thickness + 0.004, exposed=above, diameter=disc_diameter(area),
        middle=middle, albedo=albedo * np.clip(rng.normal(1, 0.08, count), 0.8, 1.2), level=level,
    )  # fmt: skip
    return blocks.chosen((above > 0.01) & (area > 0.01))
