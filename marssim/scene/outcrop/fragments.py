"""Fragments: angular pieces of 2 to 12 cm that broke off large rocks and ledges, and lie at their feet."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from marssim.scene.outcrop.config import Traits
from marssim.scene.outcrop.plates import Plates
from marssim.scene.outcrop.resting import Ground, camera_distance
from marssim.scene.outcrop.shedding import Shedding, shed
from marssim.scene.rocks.mesh import LiftAt, Rocks, mesh_population, no_bodies
from marssim.scene.rocks.population import RockPopulation, detail_level, draw_burial, mean_burial
from marssim.scene.rocks.shape_library import VARIANTS
from marssim.scene.rocks.shapes import FAMILIES

SIZES = (0.02, 0.12)  # [m] diameters
LAW = Shedding(sizes=SIZES, steepness=1.8, largest_share=0.35, most=60, reach=0.35)
LEAST_PARENT = 0.25  # [m] diameter of the smallest rocks and blocks that have fragments
BROKEN = 0.6  # share of these that have some
MEAN_NUMBER = 6.0  # pieces of a body of 0.5 m at a density of 1, over all bodies, broken or not
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
    density = traits.fragments * MEAN_NUMBER / BROKEN * (rng.random(len(parents)) < BROKEN)
    pieces = shed(LAW, density, middle[parents], size[parents], rng)
    count, diameter = len(pieces), pieces.diameter
    if count == 0:
        return no_bodies()
    distance = camera_distance(pieces.xy, half)
    family = rng.choice(len(FAMILIES), count, p=SHARES)
    detail = np.minimum(detail_level(diameter, distance), 0)
    buried = draw_burial(BURIED, count, rng)
    height = diameter * rng.uniform(*FLAT, count) * (1 - buried) / (1 - mean_burial(BURIED))
    drawn = RockPopulation(
        xy=pieces.xy, diameter=diameter, height=height, buried=buried,
        level=detail, family=family, variant=rng.integers(0, VARIANTS, count), yaw=rng.uniform(0, 2 * np.pi, count),
        stretch=np.sqrt(rng.uniform(0.5, 1.0, count)),
        albedo=albedo[parents[pieces.parent]] * np.clip(rng.normal(1, 0.12, count), 0.7, 1.4),
    )  # fmt: skip
    kept = diameter > LEAST_ANGLE * distance
    drawn = drawn.chosen(np.flatnonzero(kept)[np.argsort(-detail[kept], kind="stable")][:most])
    return mesh_population(drawn, height_at, lift)
