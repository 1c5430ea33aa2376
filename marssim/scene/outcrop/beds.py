"""Beds on slabs: what is left of the thin beds that lay on a slab and broke back from its edges, one on another."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from marssim.scene.outcrop.plates import Plates
from marssim.scene.outcrop.polygons import area_and_centroid

MOST = 3  # beds on a slab
LAYERED = 0.55  # share of slabs, and of beds, on which a part of the next bed lies
LEAST = 0.2  # [m] least diameter of what carries a bed
LEFT = (0.8, 0.97)  # size of a bed over that of what it lies on
BROKEN_AT = 0.25  # largest distance from the middle at which a bed is broken off, over the diameter
RAGGED = 0.04  # roughness of that break over the diameter
THICKNESS, ROOT = (0.005, 0.022), 0.01  # [m] of what shows of a bed, and of what does not
THICKEST = 0.06  # largest thickness that shows over the diameter
LEAN = 0.008  # standard deviation of the slope of a bed to what it lies on
LEAST_AREA = 0.2  # least area of a bed over that of what it lies on


def upper_beds(slabs: Sequence[Plates], rng: np.random.Generator) -> list[Plates]:
    """Return the beds on slabs. slabs: those of each level of detail; rng: random generator."""
    out = []
    for part in slabs:
        for _ in range(MOST):
            part = _next(part, rng)
            out.append(part)
    return [part for part in out if len(part)]


def _next(below: Plates, rng: np.random.Generator) -> Plates:
    """Return the beds that lie on some plates."""
    some = below.chosen((rng.random(len(below)) < LAYERED) & (below.diameter > LEAST))
    count = len(some)
    middle = some.outline.mean(axis=1, keepdims=True)
    angle = rng.uniform(0, 2 * np.pi, count)
    across = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    arm = (some.outline - middle) * rng.uniform(*LEFT, (count, 1, 1))
    end = some.diameter[:, None] * (
        BROKEN_AT * rng.uniform(-1, 1, (count, 1)) + RAGGED * rng.uniform(-1, 1, arm.shape[:2])
    )
    beyond = np.maximum(np.einsum("npi,ni->np", arm, across) - end, 0)
    shape = middle + arm - beyond[..., None] * across[:, None]
    area, centre = area_and_centroid(shape, np.full(count, shape.shape[1]))
    bed = np.minimum(rng.uniform(*THICKNESS, count), THICKEST * some.diameter)
    lean = rng.normal(0, LEAN, (count, 2))
    beds = Plates(
        outline=shape, plane=some.plane + np.column_stack([bed - np.einsum("ni,ni->n", lean, middle[:, 0]), lean]),
        thickness=bed + ROOT, exposed=some.exposed + bed, middle=centre, undercut=rng.uniform(0, 0.03, count),
        bevel=0.15 * bed + 0.001, diameter=np.sqrt(4 / np.pi * np.maximum(area, 0)),
        albedo=some.albedo * np.clip(rng.normal(1, 0.05, count), 0.85, 1.15), level=some.level,
    )  # fmt: skip
    return beds.chosen(area > LEAST_AREA * np.pi / 4 * some.diameter**2)
