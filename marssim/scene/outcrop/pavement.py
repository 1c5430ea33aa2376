"""Slabs: a sheet of bedrock, broken into plates that fit together, in patches, and partly under sand.

A sheet is cut into Voronoi cells, and large cells are cut again along chords across their length, so that fractures end
at older ones. Joints open between the plates, and corners chip off. Where the sheet is disturbed, its joints are wider
and its plates are tilted. A tilted plate dips into the sand: its low side is hidden, and its outline ends there.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial import Voronoi
from scipy.special import ndtri

from marssim.scene.outcrop.config import Traits
from marssim.scene.outcrop.plates import POINTS, Plates
from marssim.scene.outcrop.polygons import (
    Polygons,
    area_and_centroid,
    clip,
    clip_some,
    inset,
    outline,
    perimeter,
    stacked,
)
from marssim.scene.outcrop.waves import Waves
from marssim.scene.rocks.mesh import ground_plane
from marssim.scene.rocks.population import CAMERA_EXTENT, LEAST_DISTANCE

Ground = Callable[[np.ndarray, np.ndarray], np.ndarray]

REACH, FARTHEST = 2.5, 24.0  # slabs reach this many half sides of the fine square, or so far beyond it [m]
PATCH = (7.0, 22.0)  # [m] shortest and longest wavelength of the patches of pavement
DISTURBED = (4.0, 12.0)  # [m] wavelengths of intact and disturbed parts
CELL = 2.2  # size of the first plates, over that of the final ones
FARTHER = 0.6  # margin around patches within which the sheet is drawn, so that it has no border of its own
STRETCH = 1.5  # largest ratio of the axes along and across the joints
SPREAD = 0.55  # standard deviation of the logarithm of the plates' diameters
ROUNDS = 5  # cuts of a plate
SPLIT = 1.6  # area over the wanted one from which on a plate is cut again
OFF_CENTRE = 0.2  # largest distance of a cut from the plate's middle, over the root of its area
COMPACT = 0.45  # least 4 pi area / perimeter^2 of a plate, 0.785 for a square; splinters are left out
LEAST_ANGLE = 0.03  # [rad] angle under which a camera sees the smallest slabs that are drawn
LEAST_SLAB = 0.13  # [m] diameter of the smallest slabs
JOINT = (0.012, 0.09)  # [m] width of joints in intact and in disturbed parts
CHIPS = 3  # corners of a plate that may chip off
CHIP = 0.3  # largest part of a corner's distance from the middle that chips off
BITE, BITTEN = (0.08, 0.3), 0.3  # depth of the bites that some plates have lost, over the radius; share of these
ROUNDNESS = 0.6  # how round the corners of the roundest plates are, 0 to 1
LEVEL_ANGLES = (0.06, 0.18)  # [rad] angular diameters at which a slab gets the next level of detail
STEEPEST = np.tan(np.deg2rad(15))
BARE = 0.7  # a slab that would stand this much of the least height is under sand
HEIGHTS = (0.02, 0.15)  # [m] least and largest height of a slab's highest edge
TALLEST = 0.25  # largest height of a slab's highest edge over its diameter
LIFTED = 1.6  # largest rise of a plate across its radius, over the height of its highest edge
HOLLOW = 0.2  # share of the steep plates that are thin and show a gap below their high edge
BURIED = 0.04  # [m] depth that the sides of the others reach below the ground
SHOWN = 0.2  # least share of a plate above the ground
DRIFTS = (1.5, 5.0)  # [m] wavelengths of the sand that lies higher here and lower there


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
    threshold = float(ndtri(1 - traits.slabs))
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
    return _settled(corners, count, loose, traits, half, height_at, rng)


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
    diagram = Voronoi(sites[near])
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
    least = LEAST_ANGLE * _distance(middle, half)
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


def _settled(
    corners: np.ndarray, count: np.ndarray, loose: np.ndarray, traits: Traits, half: float, height_at: Ground,
    rng: np.random.Generator,
) -> list[Plates]:  # fmt: skip
    """Lay plates on the ground, tilted, and return those that show, by level of detail. loose: (N,) 0 to 1."""
    area, middle = area_and_centroid(corners, count)
    diameter = np.sqrt(4 / np.pi * np.maximum(area, 0))
    away = _distance(middle, half)
    compact = 4 * np.pi * area / np.maximum(perimeter(corners, count), 1e-9) ** 2
    fit = (count >= 3) & (compact > COMPACT) & (diameter > np.maximum(LEAST_SLAB, LEAST_ANGLE * away))
    out = []
    draws: np.ndarray = rng.random((3, len(count)))
    swing: np.ndarray = np.abs(rng.normal(size=len(count)))
    height = traits.slab_height * np.exp(0.4 * rng.normal(size=len(count)) + 0.45 * Waves.draw(*DRIFTS, rng).at(middle))
    fit &= height > BARE * HEIGHTS[0]
    height = np.clip(np.minimum(height, TALLEST * diameter), *HEIGHTS)
    level = np.digitize(diameter / away, LEVEL_ANGLES)
    for detail in range(len(POINTS) - 1, -1, -1):
        which = np.flatnonzero(fit & (level == detail))
        if len(which) == 0:
            continue
        shape = worn_outlines(corners[which], count[which], POINTS[detail], ROUNDNESS, rng)
        ground, slope = ground_plane(middle[which], diameter[which], height_at)
        angle = 2 * np.pi * draws[0, which]
        tilt = np.tan(np.deg2rad(traits.slab_tilt_deg)) * swing[which] * (0.5 + loose[which])
        tilt = np.minimum(np.minimum(tilt, LIFTED * height[which] / (diameter[which] / 2)), STEEPEST)
        lean = tilt[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        steep = slope + lean
        rise = ground[:, None] + np.einsum("npi,ni->np", shape - middle[which][:, None], steep)
        rise = (rise - height_at(shape[..., 0], shape[..., 1])).max(axis=1)  # of the highest edge over the middle
        above = height[which] - rise  # of the plate's middle
        hollow = (draws[1, which] < HOLLOW) & (rise > 0.5 * height[which])
        thickness = np.where(hollow, 0.03 + 0.5 * height[which], height[which] + BURIED)
        offset = above - np.einsum("ni,ni->n", lean, middle[which])
        shown, corners_shown = clip(shape, np.full(len(which), POINTS[detail]), -lean, offset)
        part, centre = area_and_centroid(shown, corners_shown)
        plane = np.column_stack([ground + above - np.einsum("ni,ni->n", steep, middle[which]), steep])
        slabs = Plates(
            outline=shape, plane=plane, thickness=thickness, undercut=0.02 + 0.1 * draws[2, which],
            bevel=0.1 * thickness + 0.004, exposed=height[which],
            diameter=np.sqrt(4 / np.pi * np.maximum(part, 0)), middle=centre,
            albedo=traits.brightness * np.clip(rng.normal(1, 0.07, len(which)), 0.8, 1.2),
            level=detail,
        )  # fmt: skip
        out.append(slabs.chosen(part > SHOWN * area[which]))
    return out


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
    lost += rng.uniform(0, 0.06, (number, points))
    return np.asarray(middle + (shape - middle) * (1 - lost)[..., None])


def _distance(xy: np.ndarray, half: float) -> np.ndarray:
    """Return the least distances [m] of a camera from points (N, 2)."""
    away: np.ndarray = np.abs(xy).max(axis=1, initial=0) - CAMERA_EXTENT * half
    return np.maximum(away, 0) + LEAST_DISTANCE
