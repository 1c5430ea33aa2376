"""Fragments: angular pieces of 2 to 12 cm that broke off large rocks and ledges, and lie at their feet."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from marssim.scene.outcrop.config import Traits
from marssim.scene.outcrop.laying import Ground
from marssim.scene.outcrop.plates import Plates
from marssim.scene.rocks.mesh import LiftAt, Rocks, ground_plane, least_lift, mesh_population, no_bodies
from marssim.scene.rocks.population import (
    CAMERA_EXTENT,
    LEAST_DISTANCE,
    RockPopulation,
    detail_level,
    draw_burial,
    mean_burial,
)
from marssim.scene.rocks.shape_library import VARIANTS
from marssim.scene.rocks.shapes import FAMILIES

SIZES = (0.02, 0.12)  # [m] diameters; the number of pieces larger than D falls as D^-STEEPNESS
STEEPNESS = 1.8
LARGEST_SHARE = 0.35  # largest diameter over that of the body that the piece broke off
LEAST_PARENT = 0.25  # [m] diameter of the smallest rocks and blocks that have fragments
BROKEN = 0.6  # share of these that have some
PIECES = 6.0  # mean number of pieces of a broken body of 0.5 m at a density of 1; it grows with the diameter
MOST = 60  # pieces of a body
REACH = 0.35  # mean distance of a piece from the foot, over the body's diameter
LEAST_ANGLE = 0.005  # [rad] angle under which a camera sees the smallest pieces that are drawn: 3 px of 512
FLAT = (0.2, 0.6)  # height above ground over diameter, at a mean burial
BURIED = (0.3, 0.75)  # share of a piece's height below the ground
SHARES = (0.45, 0.55, 0.0)  # of FAMILIES


def draw_fragments(
    rocks: Rocks, plates: Sequence[Plates], traits: Traits, half: float, height_at: Ground, lift: LiftAt | None,
    most: int, rng: np.random.Generator,
) -> Rocks:  # fmt: skip
    """Draw the fragments of a scene.

    Args:
        rocks: The rocks.
        plates: Slabs and blocks of ledges.
        traits: What the scene drew.
        half: Half the side of the finely gridded square [m].
        height_at: Function of x, y [m] that returns the height of the ground [m].
        lift: Function of x, y and the height of the ground [m] that returns how far bedrock stands above it [m].
        most: Largest number of fragments.
        rng: Random generator.
    """
    middle = np.concatenate([rocks.centre[:, :2], *(part.middle for part in plates)])
    size = np.concatenate([rocks.diameter, *(part.diameter for part in plates)])
    tall = np.concatenate([rocks.height, *(part.exposed for part in plates)])
    albedo = np.concatenate([rocks.albedo, *(part.albedo for part in plates)])
    parents = np.flatnonzero((size > LEAST_PARENT) & (tall > 0.3 * LEAST_PARENT) & (np.abs(middle) < half).all(axis=1))
    mean = traits.fragments * PIECES / BROKEN * size[parents] / 0.5 * (rng.random(len(parents)) < BROKEN)
    parent = np.repeat(parents, np.minimum(rng.poisson(mean), MOST))
    count = len(parent)
    if count == 0:
        return no_bodies()
    level = rng.uniform(SIZES[1] ** -STEEPNESS, SIZES[0] ** -STEEPNESS, count)
    diameter = level ** (-1 / STEEPNESS)
    angle = rng.uniform(0, 2 * np.pi, count)
    away = 0.5 * size[parent] * rng.uniform(0.9, 1.2, count) + REACH * size[parent] * rng.exponential(1, count)
    xy = middle[parent] + away[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    distance = np.maximum(np.abs(xy).max(axis=1) - CAMERA_EXTENT * half, 0) + LEAST_DISTANCE
    family = rng.choice(len(FAMILIES), count, p=SHARES)
    detail = np.minimum(detail_level(diameter, distance), 0)
    buried = draw_burial(BURIED, count, rng)
    height = diameter * rng.uniform(*FLAT, count) * (1 - buried) / (1 - mean_burial(BURIED))
    drawn = RockPopulation(
        xy=xy, diameter=diameter, height=height, buried=buried,
        level=detail, family=family, variant=rng.integers(0, VARIANTS, count), yaw=rng.uniform(0, 2 * np.pi, count),
        stretch=np.sqrt(rng.uniform(0.5, 1.0, count)),
        albedo=albedo[parent] * np.clip(rng.normal(1, 0.12, count), 0.7, 1.4),
    )  # fmt: skip
    kept = (diameter < LARGEST_SHARE * size[parent]) & (diameter > LEAST_ANGLE * distance)
    drawn = drawn.chosen(np.flatnonzero(kept)[np.argsort(-detail[kept], kind="stable")][:most])
    ground, slope = ground_plane(drawn.xy, drawn.diameter, height_at)
    if lift is not None:
        ground = ground + least_lift(drawn.xy, drawn.diameter, height_at, lift)
    return mesh_population(drawn, ground, slope)
