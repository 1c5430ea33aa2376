"""Slabs: a sheet of bedrock, broken into plates that fit together, in patches, and partly under sand.

A sheet is cut into Voronoi cells, and large cells are cut again along chords across their length, so that fractures end
at older ones. Joints open between the plates, and corners chip off. Where the sheet is disturbed, its joints are wider
and its plates are tilted. A tilted plate dips into the sand: its low side is hidden, and its outline ends there.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy

from marssim.scene.outcrop.config import Traits
from marssim.scene.outcrop.laying import LEAST_ANGLE, lay_slabs
from marssim.scene.outcrop.plates import Plates
from marssim.scene.outcrop.polygons import (
    Polygons,
    area_and_centroid,
    clip,
    clip_some,
    inset,
    stacked,
)
from marssim.scene.outcrop.resting import Ground, camera_distance
from marssim.scene.outcrop.waves import Waves

REACH, FARTHEST = 2.5, 24.0  # slabs reach this many half sides of the fine square, or so far beyond it [m]
PATCH = (7.0, 22.0)  # [m] shortest and longest wavelength of the patches of pavement
DISTURBED = (4.0, 12.0)  # [m] wavelengths of intact and disturbed parts
CELL = 2.2  # size of the first plates, over that of the final ones
FARTHER = 0.6  # margin around patches within which the sheet is drawn, so that it has no border of its own
STRETCH = 2.2  # largest ratio of the axes along and across the joints
SPREAD = 0.55  # standard deviation of the logarithm of the plates' diameters
ROUNDS = 5  # cuts of a plate
SPLIT = 1.6  # area over the wanted one from which on a plate is cut again
OFF_CENTRE = 0.2  # largest distance of a cut from the plate's middle, over the root of its area
JOINT = (0.012, 0.09)  # [m] width of joints in intact and in disturbed parts
CHIPS = 3  # corners of a plate that may chip off
CHIP = 0.3  # largest part of a corner's distance from the middle that chips off


def draw_slabs(
    traits: Traits, half: float, horizon: float, height_at: Ground, rng: np.random.Generator
) -> list[Plates]:
    """Draw the slabs of a scene.

    Args:
        traits: What the scene drew.
        half: Half the side of the finely gridded square [m].
        horizon: Half the side of the whole scene [m].
        height_at: Function of x, y [m] that returns the height of the ground [m].
        rng: Random generator.

    Returns:
        The slabs of each level of detail, the finest first.
    """
    if traits.slabs == 0:
        return []
    patches, disturbed = Waves.draw(*PATCH, rng), Waves.draw(*DISTURBED, rng)
    threshold = float(scipy.special.ndtri(1 - traits.slabs))
    reach = min(REACH * half, half + FARTHEST, horizon - 1)
    corners, count = _sheet(traits.slab_size, reach, lambda xy: patches.at(xy) - threshold, rng)
    if len(count) == 0:
        return []
    corners, count = _broken(corners, count, traits.slab_size, half, rng)
    middle = area_and_centroid(corners, count)[1]
    loose = 1 / (1 + np.exp(-2 * disturbed.at(middle)))  # 0 intact, 1 disturbed
    share = 0.35 + 0.9 * (patches.at(middle) - threshold) - 0.25 * loose
    kept = (rng.random(len(count)) < share) & (share > 0)
    corners, count, loose = corners[kept], count[kept], loose[kept]
    if not kept.any():
        return []
    corners, count = _worn(corners, count, loose, rng)
    return lay_slabs(corners, count, loose, traits, half, height_at, rng)


def _sheet(
    size: float, reach: float, margin_at: Callable[[np.ndarray], np.ndarray], rng: np.random.Generator
) -> Polygons:
    """Return the Voronoi cells of a sheet in its patches. margin_at: how far inside a patch points (N, 2) lie."""
    cell, turn, stretch = CELL * size, rng.uniform(0, np.pi), np.sqrt(rng.uniform(1, STRETCH))
    number = int(np.ceil(reach * np.sqrt(2) * stretch / cell))
    grid = np.stack(np.meshgrid(*[np.arange(-number, number + 1)] * 2), axis=-1).reshape(-1, 2)
    sites = cell * (grid + rng.uniform(-0.45, 0.45, grid.shape))
    c, s = np.cos(turn), np.sin(turn)
    to_world = np.array([[c, s], [-s, c]]) * [[stretch], [1 / stretch]]
    world = sites @ to_world
    near = (np.abs(world).max(axis=1) < reach + 2 * cell) & (margin_at(world) > -FARTHER)
    if near.sum() < 4:
        return np.zeros((0, 3, 2)), np.zeros(0, int)
    diagram = scipy.spatial.Voronoi(sites[near])
    inside = np.flatnonzero((np.abs(world[near]).max(axis=1) < reach) & (margin_at(world[near]) > 0))
    regions = [diagram.regions[diagram.point_region[n]] for n in inside]
    closed = [region for region in regions if region and -1 not in region]
    count = np.array([len(region) for region in closed], dtype=int)
    valid = np.arange(count.max(initial=3)) < count[:, None]
    corners = np.zeros((*valid.shape, 2))
    corners[valid] = diagram.vertices[[vertex for region in closed for vertex in region]]
    arm = corners - corners.sum(axis=1, keepdims=True) / count[:, None, None]
    order = np.argsort(np.where(valid, np.arctan2(arm[..., 1], arm[..., 0]), np.inf), axis=1)
    near = np.where(valid, np.abs(arm).max(axis=2), 0).max(axis=1, initial=0) < 2 * cell
    corners = np.take_along_axis(corners, order[..., None], axis=1)[near]
    return corners @ to_world, count[near]


def _broken(corners: np.ndarray, count: np.ndarray, size: float, half: float, rng: np.random.Generator) -> Polygons:
    """Cut plates until they have the size that each of them draws, or that a camera can see."""
    area, middle = area_and_centroid(corners, count)
    least = LEAST_ANGLE * camera_distance(middle, half)
    wanted = np.maximum(size * rng.lognormal(0, SPREAD, len(count)), 1.3 * least)
    for _ in range(ROUNDS):
        area, middle = area_and_centroid(corners, count)
        large = area > SPLIT * np.pi / 4 * wanted**2
        if not large.any():
            break
        normal = _across(corners[large], count[large], rng)
        offset = np.einsum("ni,ni->n", normal, middle[large])
        offset += OFF_CENTRE * np.sqrt(area[large]) * rng.uniform(-1, 1, int(large.sum()))
        parts = [clip(corners[large], count[large], side * normal, side * offset) for side in (1, -1)]
        wanted = np.concatenate([wanted[~large], wanted[large], wanted[large]])
        corners, count = stacked([(corners[~large], count[~large]), *parts])
    good = count >= 3
    return corners[good], count[good]


def _across(corners: np.ndarray, count: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return the directions (N, 2) of the longest extent of polygons, each turned by a random angle."""
    valid = (np.arange(corners.shape[1]) < count[:, None])[..., None]
    arm = np.where(valid, corners - np.where(valid, corners, 0).sum(axis=1, keepdims=True) / count[:, None, None], 0)
    moment = np.einsum("nmi,nmj->nij", arm, arm)
    angle = 0.5 * np.arctan2(2 * moment[:, 0, 1], moment[:, 0, 0] - moment[:, 1, 1]) + rng.normal(0, 0.35, len(count))
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _worn(corners: np.ndarray, count: np.ndarray, loose: np.ndarray, rng: np.random.Generator) -> Polygons:
    """Open the joints around plates and chip corners off. Plates of which nothing is left have no corners."""
    joint = JOINT[0] + (JOINT[1] - JOINT[0]) * loose * rng.random(len(count))
    gap = 0.5 * joint[:, None] * rng.uniform(0.4, 1.8, corners.shape[:2])
    corners, count = inset(corners, count, gap)
    for _ in range(CHIPS):
        middle = area_and_centroid(corners, count)[1]
        corner = corners[np.arange(len(count)), (rng.random(len(count)) * np.maximum(count, 1)).astype(int)]
        arm = corner - middle
        length = np.maximum(np.hypot(*arm.T), 1e-9)
        angle = np.arctan2(arm[:, 1], arm[:, 0]) + rng.normal(0, 0.4, len(count))
        normal = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        cut = length * CHIP * rng.uniform(-1, 1, len(count))  # half of the time nothing
        some = cut > 0
        offset = np.einsum("ni,ni->n", normal, corner) - cut
        corners, count = clip_some(corners, count, some, normal[some], offset[some])
    return corners, count
