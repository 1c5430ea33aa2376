"""Laying slabs on the ground: how each is tilted and worn, how high its edge stands, and how much of it shows."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from marssim.scene.outcrop.config import Traits
from marssim.scene.outcrop.plates import POINTS, Plates
from marssim.scene.outcrop.polygons import area_and_centroid, disc_diameter, outline, perimeter
from marssim.scene.outcrop.resting import Ground, camera_distance, rest
from marssim.scene.outcrop.waves import Waves

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
NOTCH_WIDTHS = (1, 3, 7)  # [points] widths of the notches in the outline
NOTCH_DEPTH = 0.0173  # standard deviation of the depth of those 1 point wide over the radius; it grows as the width^0.5
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
    diameter, away = disc_diameter(area), camera_distance(middle, half)
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
    lie = rest(shape, pieces.middle, disc_diameter(pieces.area), pieces.lean, pieces.height, height_at)
    hollow = (pieces.chance < HOLLOW) & (lie.rise > 0.5 * pieces.height)
    thickness = np.where(hollow, 0.03 + 0.5 * pieces.height, pieces.height + BURIED)
    count = len(shape)
    slabs = Plates(
        outline=shape, plane=lie.plane, thickness=thickness, exposed=pieces.height, middle=lie.middle, level=level,
        undercut=rng.uniform(0.02, 0.12, count), bevel=0.1 * thickness + 0.004, diameter=disc_diameter(lie.area),
        albedo=brightness * np.clip(rng.normal(1, 0.07, count), 0.8, 1.2),
    )  # fmt: skip
    return slabs.chosen(lie.area > SHOWN * pieces.area)


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
    for width in NOTCH_WIDTHS:
        if width <= points / 4:
            lost += NOTCH_DEPTH * width**0.5 * _notches(rng.uniform(0, 12**0.5, (number, points)), width)
    return np.asarray(middle + (shape - middle) * (1 - lost)[..., None])


def _notches(noise: np.ndarray, width: int) -> np.ndarray:
    """Return noise of closed rows (N, P), independent and of variance 1, as noise that is alike over `width` points.

    Each value is the sum of the `width` values around it, an odd number, scaled so that the variance stays 1, and
    shifted so that the mean stays.
    """
    mean = 3**0.5  # of uniform noise from 0 with a variance of 1
    around = range(-(width // 2), width // 2 + 1)
    total = np.sum([np.roll(noise - mean, k, axis=1) for k in around], axis=0)
    return np.asarray(mean + total / np.sqrt(width))
