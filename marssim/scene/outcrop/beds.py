"""Beds on slabs: what is left of the thin beds that lay on a slab and broke back from its edges, one on another."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from marssim.scene.outcrop.plates import Plates, nearest, outside
from marssim.scene.outcrop.polygons import area_and_centroid, disc_diameter
from marssim.scene.outcrop.resting import Ground, ground_under, shown_part

MAX_BEDS = 3  # beds on a slab
LAYERED_SHARE = 0.55  # share of slabs, and of beds, on which a part of the next bed lies
MIN_DIAMETER = 0.2  # [m] of the smallest slabs and beds that carry a bed
SIZE_SHARES = (0.8, 0.97)  # size of a bed before it broke, over that of what it lies on
BREAK_DISTANCE = 0.25  # largest distance of the break from the middle, over the diameter of what the bed lies on
BREAK_ROUGHNESS = 0.04  # largest deviation of the break from a straight line, over that diameter
MIN_AREA_SHARE = 0.2  # least area of a bed over that of what it lies on
THICKNESS = (0.005, 0.022)  # [m] of what shows of a bed
MAX_THICKNESS_SHARE = 0.06  # largest such thickness over the diameter of what the bed lies on
ROOT = 0.01  # [m] depth of a bed's sides below the top that it lies on
LEAN_SPREAD = 0.008  # standard deviation of the slope of a bed to what it lies on
UNDERCUT = (0.0, 0.03)  # how far the bottom of a bed lies inside its outline, over its radius
BEVEL_SHARE, MIN_BEVEL = 0.15, 0.001  # width of the worn edge: over the thickness that shows, and least addition [m]
ALBEDO_SPREAD, ALBEDO_RATIOS = 0.05, (0.85, 1.15)  # brightness over that of what the bed lies on: spread, and limits


def upper_beds(
    slabs: Sequence[Plates], height_at: Ground, clear: tuple[tuple[float, float, float], ...], most: int,
    rng: np.random.Generator,
) -> list[Plates]:  # fmt: skip
    """Return the beds on slabs. Each bed lies on one of the slabs or on another of the beds.

    Args:
        slabs: The slabs of each level of detail.
        height_at: Function of x, y [m] that returns the height of the ground [m].
        clear: Discs (x, y, radius) [m] that stay free of beds.
        most: Largest number of beds. Those nearest to the scene's middle are kept, and lower ones before upper ones.
        rng: Random generator.
    """
    layer, beds = list(slabs), list[Plates]()
    for _ in range(MAX_BEDS):
        layer = outside([_next(part, height_at, rng) for part in layer], clear)
        layer = nearest(layer, most - sum(map(len, beds)))
        beds += layer
    return [part for part in beds if len(part)]


def _next(below: Plates, height_at: Ground, rng: np.random.Generator) -> Plates:
    """Return the beds that lie on some plates."""
    some = below.chosen((rng.random(len(below)) < LAYERED_SHARE) & (below.diameter > MIN_DIAMETER))
    count = len(some)
    shape = _broken(some, rng)
    centre = area_and_centroid(shape, np.full(count, shape.shape[1]))[1]
    bed = np.minimum(rng.uniform(*THICKNESS, count), MAX_THICKNESS_SHARE * some.diameter)
    lean = rng.normal(0, LEAN_SPREAD, (count, 2))
    middle = some.outline.mean(axis=1)
    plane = some.plane + np.column_stack([bed - np.einsum("ni,ni->n", lean, middle), lean])
    area, shown = shown_part(shape, plane - ground_under(centre, some.diameter, height_at))
    beds = Plates(
        outline=shape, plane=plane, thickness=bed + ROOT, exposed=some.exposed + bed, middle=shown,
        undercut=rng.uniform(*UNDERCUT, count), bevel=BEVEL_SHARE * bed + MIN_BEVEL, diameter=disc_diameter(area),
        albedo=some.albedo * np.clip(rng.normal(1, ALBEDO_SPREAD, count), *ALBEDO_RATIOS), level=some.level,
    )  # fmt: skip
    return beds.chosen(area > MIN_AREA_SHARE * np.pi / 4 * some.diameter**2)


def _broken(below: Plates, rng: np.random.Generator) -> np.ndarray:
    """Return outlines (N, P, 2) within those of plates, smaller ones of which one side is broken off."""
    count = len(below)
    middle = below.outline.mean(axis=1, keepdims=True)
    angle = rng.uniform(0, 2 * np.pi, count)
    across = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    arm = (below.outline - middle) * rng.uniform(*SIZE_SHARES, (count, 1, 1))
    at = np.einsum("npi,ni->np", arm, across)
    rough = BREAK_ROUGHNESS * rng.uniform(-1, 1, at.shape)
    end = below.diameter[:, None] * (BREAK_DISTANCE * rng.uniform(-1, 1, (count, 1)) + rough)
    far = np.argmin(at, axis=1)[:, None]  # points beyond the break move towards this one, so that they stay inside
    least = np.take_along_axis(at, far, axis=1)
    share = np.clip((at - end) / np.maximum(at - least, 1e-9), 0, 1)[..., None]
    return middle + _within(arm, (1 - share) * arm + share * np.take_along_axis(arm, far[..., None], axis=1))


def _within(outline: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return points (N, Q, 2), moved towards the origin where they lie outside outlines (N, P, 2) around it."""
    start, side = outline[:, None], (np.roll(outline, -1, axis=1) - outline)[:, None]
    along = points[:, :, None]
    slant = along[..., 0] * side[..., 1] - along[..., 1] * side[..., 0]  # 0 for sides that the ray does not meet
    slant = np.where(np.abs(slant) < 1e-12, np.inf, slant)
    place = (start[..., 0] * along[..., 1] - start[..., 1] * along[..., 0]) / slant  # of the meeting, along the side
    reach = (start[..., 0] * side[..., 1] - start[..., 1] * side[..., 0]) / slant  # of the side, over the point's
    met = (place >= 0) & (place <= 1) & (reach > 0)
    return np.asarray(points * np.where(met, reach, np.inf).min(axis=2).clip(max=1)[..., None])
