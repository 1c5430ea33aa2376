"""Laying slabs on the ground: how each is tilted and worn, how high its edge stands, and how much of it shows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np

from marssim.scene.outcrop.config import Traits
from marssim.scene.outcrop.plates import POINTS, Plates
from marssim.scene.outcrop.polygons import area_and_centroid, clip, outline, perimeter
from marssim.scene.outcrop.waves import Waves
from marssim.scene.rocks.mesh import ground_plane
from marssim.scene.rocks.population import CAMERA_EXTENT, LEAST_DISTANCE

Ground = Callable[[np.ndarray, np.ndarray], np.ndarray]

LEAST_ANGLE = 0.03  # [rad] angle under which a camera sees the smallest slabs that are drawn
LEAST_SLAB = 0.13  # [m] diameter of the smallest slabs
BITE, BITTEN = (0.08, 0.4), 0.5  # depth of the bites that some plates have lost, over the radius; share of these
ROUNDNESS = 0.4  # how round the corners of the roundest plates are, 0 to 1
DRIFTS = (1.5, 5.0)  # [m] wavelengths of the sand that lies higher here and lower there
LEVEL_ANGLES = (0.05, 0.13)  # [rad] angular diameters at which a slab gets the next level of detail
STEEPEST = np.tan(np.deg2rad(15))
BARE = 0.7  # a slab that would stand this much of the least height is under sand
HEIGHTS = (0.02, 0.15)  # [m] least and largest height of a slab's highest edge
DIP_SPREAD = 1.0  # [rad] standard deviation of the directions in which slabs are tilted
TALLEST = 0.25  # largest height of a slab's highest edge over its diameter
LIFTED = 1.6  # largest rise of a plate across its radius, over the height of its highest edge
HOLLOW = 0.2  # share of the steep plates that are thin and show a gap below their high edge
BURIED = 0.04  # [m] depth that the sides of the others reach below the ground
SHOWN = 0.2  # least share of a plate above the ground
RAGGED, RAGGED_WIDTHS = 0.06, (1, 3, 7)  # depth of notches in the outline over the radius, and their widths [points]
COMPACT = 0.45  # least 4 pi area / perimeter^2 of a plate, 0.785 for a square; splinters are left out


@dataclass(frozen=True)
class _Pieces:
    """N pieces of a sheet before they lie on the ground.

    Attributes:
        corners: (N, M, 2) corners [m].
        count: (N,) numbers of corners.
        middle: (N, 2) centroids [m].
        area: (N,) areas [m2].
        height: (N,) heights of their highest edges above the ground [m].
        lean: (N, 2) slopes of their tops to the ground.
        chance: (N,) random numbers, 0 to 1, that decide which are hollow.
        level: (N,) levels of detail; -1 for pieces that are not drawn.
    """

    corners: np.ndarray
    count: np.ndarray
    middle: np.ndarray
    area: np.ndarray
    height: np.ndarray
    lean: np.ndarray
    chance: np.ndarray
    level: np.ndarray

    def chosen(self, which: np.ndarray) -> _Pieces:
        return _Pieces(**{f.name: getattr(self, f.name)[which] for f in fields(self)})


def lay_slabs(
    corners: np.ndarray, count: np.ndarray, loose: np.ndarray, traits: Traits, half: float, height_at: Ground,
    rng: np.random.Generator,
) -> list[Plates]:  # fmt: skip
    """Lay the pieces of a sheet on the ground.

    Args:
        corners: (N, M, 2) corners of the pieces [m].
        count: (N,) numbers of corners; pieces with less than 3 are left out.
        loose: (N,) how disturbed the sheet is there, 0 to 1.
        traits: What the scene drew.
        half: Half the side of the finely gridded square [m].
        height_at: Function of x, y [m] that returns the height of the ground [m].
        rng: Random generator.

    Returns:
        The slabs that show, of each level of detail, the finest first.
    """
    pieces = _drawn(corners, count, loose, traits, half, rng)
    groups = [np.flatnonzero(pieces.level == level) for level in range(len(POINTS) - 1, -1, -1)]
    return [_laid(pieces.chosen(group), traits.brightness, height_at, rng) for group in groups if len(group)]


def _drawn(
    corners: np.ndarray, count: np.ndarray, loose: np.ndarray, traits: Traits, half: float, rng: np.random.Generator
) -> _Pieces:
    """Draw how the pieces of a sheet lie. The arguments are those of lay_slabs."""
    area, middle = area_and_centroid(corners, count)
    diameter, away = np.sqrt(4 / np.pi * np.maximum(area, 0)), camera_distance(middle, half)
    buried = 0.4 * rng.normal(size=len(count)) + 0.45 * Waves.draw(*DRIFTS, rng).at(middle)
    height = traits.slab_height * np.exp(buried)
    compact = 4 * np.pi * area / np.maximum(perimeter(corners, count), 1e-9) ** 2
    fit = (count >= 3) & (compact > COMPACT) & (diameter > np.maximum(LEAST_SLAB, LEAST_ANGLE * away))
    fit &= height > BARE * HEIGHTS[0]
    height = np.clip(np.minimum(height, TALLEST * diameter), *HEIGHTS)
    swing: np.ndarray = np.abs(rng.normal(size=len(count)))
    tilt = np.tan(np.deg2rad(traits.slab_tilt_deg)) * swing * (0.5 + loose)
    tilt = np.minimum(np.minimum(tilt, LIFTED * height / np.maximum(diameter / 2, 1e-9)), STEEPEST)
    angle = rng.uniform(0, 2 * np.pi) + DIP_SPREAD * rng.normal(size=len(count))
    lean = tilt[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    level = np.where(fit, np.digitize(diameter / away, LEVEL_ANGLES), -1)
    return _Pieces(corners, count, middle, area, height, lean, rng.random(len(count)), level)


def _laid(pieces: _Pieces, brightness: float, height_at: Ground, rng: np.random.Generator) -> Plates:
    """Return the slabs of pieces of one level of detail, without those that the ground hides."""
    level = int(pieces.level[0])
    shape = worn_outlines(pieces.corners, pieces.count, POINTS[level], ROUNDNESS, rng)
    ground, slope = ground_plane(pieces.middle, np.sqrt(4 / np.pi * pieces.area), height_at)
    steep = slope + pieces.lean
    rise = ground[:, None] + np.einsum("npi,ni->np", shape - pieces.middle[:, None], steep)
    rise = (rise - height_at(shape[..., 0], shape[..., 1])).max(axis=1)  # of the highest edge over the middle
    above = pieces.height - rise  # of the slab's middle
    hollow = (pieces.chance < HOLLOW) & (rise > 0.5 * pieces.height)
    thickness = np.where(hollow, 0.03 + 0.5 * pieces.height, pieces.height + BURIED)
    part, middle = _shown(shape, above, pieces)
    count = len(shape)
    slabs = Plates(
        outline=shape, thickness=thickness, exposed=pieces.height, middle=middle, level=level,
        plane=np.column_stack([ground + above - np.einsum("ni,ni->n", steep, pieces.middle), steep]),
        undercut=rng.uniform(0.02, 0.12, count), bevel=0.1 * thickness + 0.004,
        diameter=np.sqrt(4 / np.pi * np.maximum(part, 0)),
        albedo=brightness * np.clip(rng.normal(1, 0.07, count), 0.8, 1.2),
    )  # fmt: skip
    return slabs.chosen(part > SHOWN * pieces.area)


def _shown(shape: np.ndarray, above: np.ndarray, pieces: _Pieces) -> tuple[np.ndarray, np.ndarray]:
    """Return the area (N,) and the centroid (N, 2) of what shows of slabs above the plane of the ground.

    Args:
        shape: (N, P, 2) outlines [m].
        above: (N,) heights of the slabs' middles above the plane [m].
        pieces: The pieces.
    """
    offset = above - np.einsum("ni,ni->n", pieces.lean, pieces.middle)
    return area_and_centroid(*clip(shape, np.full(len(shape), shape.shape[1]), -pieces.lean, offset))


def worn_outlines(
    corners: np.ndarray, count: np.ndarray, points: int, roundness: float, rng: np.random.Generator
) -> np.ndarray:
    """Return outlines (N, points, 2) of polygons that are a little worn, and of which some have lost a bite.

    Args:
        corners: (N, M, 2) corners.
        count: (N,) numbers of corners.
        points: Number of points of each outline.
        roundness: Largest share, 0 to 1, of the way that a point moves to the mean of its neighbours, twice.
        rng: Random generator.
    """
    shape = outline(corners, count, points)
    number = len(shape)
    middle = shape.mean(axis=1, keepdims=True)
    soft = roundness * rng.random((number, 1, 1))
    for _ in range(2):
        shape = (1 - soft) * shape + soft / 2 * (np.roll(shape, 1, axis=1) + np.roll(shape, -1, axis=1))
    place = np.arange(points) / points * 2 * np.pi
    bite = np.where(rng.random(number) < BITTEN, rng.uniform(*BITE, number), 0.0)
    apart = np.abs((place - rng.uniform(0, 2 * np.pi, (number, 1)) + np.pi) % (2 * np.pi) - np.pi)
    lost = bite[:, None] * np.exp(-((apart / rng.uniform(0.25, 0.5, (number, 1))) ** 2))
    for width in RAGGED_WIDTHS:  # of points
        if width <= points / 4:
            lost += RAGGED * width**0.5 * _loop_mean(rng.uniform(0, 1, (number, points)), width)
    return np.asarray(middle + (shape - middle) * (1 - lost)[..., None])


def _loop_mean(values: np.ndarray, width: int) -> np.ndarray:
    """Return the means of `width` neighbours around each value of closed rows (N, P), scaled to their variance."""
    total = np.sum([np.roll(values - 0.5, k, axis=1) for k in range(width)], axis=0)
    return np.asarray(0.5 + total / np.sqrt(width))


def camera_distance(xy: np.ndarray, half: float) -> np.ndarray:
    """Return the least distances [m] of a camera from points (N, 2)."""
    away: np.ndarray = np.abs(xy).max(axis=1, initial=0) - CAMERA_EXTENT * half
    return np.maximum(away, 0) + LEAST_DISTANCE
