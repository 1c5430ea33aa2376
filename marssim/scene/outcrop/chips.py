"""Chips: thin pieces of 3 to 25 cm that split off slabs and ledges, and lie flat around them, partly under sand."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from marssim.scene.outcrop.config import Traits
from marssim.scene.outcrop.laying import Ground, camera_distance, worn_outlines
from marssim.scene.outcrop.plates import POINTS, Plates
from marssim.scene.outcrop.polygons import area_and_centroid
from marssim.scene.rocks.mesh import ground_plane

SIZES = (0.03, 0.25)  # [m] diameters; the number of chips larger than D falls as D^-STEEPNESS
STEEPNESS = 1.6
LARGEST_SHARE = 0.5  # largest diameter over that of the plate that the chip split off
PIECES = 10.0  # mean number of chips of a plate of 0.5 m at a density of fragments of 1; it grows with the diameter
UNEVEN = 1.2  # standard deviation of the logarithm of that number among plates
MOST = 40  # chips of a plate
REACH = 0.4  # mean distance of a chip from the foot, over the plate's diameter
LEAST_ANGLE = 0.008  # [rad] angle under which a camera sees the smallest chips that are drawn
LEVEL_ANGLE = 0.03  # [rad] angular diameter from which on a chip has an outline of the middle level of detail
CORNERS = 6  # of a chip before its edges are worn
NARROW = (0.3, 0.85)  # width over length
STRIKE = 0.6  # [rad] standard deviation of the directions of chips: they split along the same joints
THICK = (0.06, 0.22)  # height of the highest edge above the sand over the diameter
EDGE = (0.005, 0.04)  # [m] least and largest height of that edge
TILT, STEEPEST = 8.0, 25.0  # [deg] standard deviation of the tilt, and largest tilt
ROOT = 0.02  # [m] depth of the sides below the ground


def draw_chips(
    parents: Sequence[Plates], traits: Traits, half: float, height_at: Ground, rng: np.random.Generator
) -> list[Plates]:
    """Draw the chips of a scene.

    Args:
        parents: Slabs and blocks of ledges.
        traits: What the scene drew.
        half: Half the side of the finely gridded square [m].
        height_at: Function of x, y [m] that returns the height of the ground [m].
        rng: Random generator.

    Returns:
        The chips that a camera can see, of each level of detail.
    """
    if not parents or traits.fragments == 0:
        return []
    middle, size, albedo = (
        np.concatenate([getattr(part, name) for part in parents]) for name in ("middle", "diameter", "albedo")
    )
    mean = traits.fragments * PIECES * size / 0.5 * rng.lognormal(-0.5 * UNEVEN**2, UNEVEN, len(size))
    parent = np.repeat(np.arange(len(size)), np.minimum(rng.poisson(mean), MOST))
    count = len(parent)
    diameter = rng.uniform(SIZES[1] ** -STEEPNESS, SIZES[0] ** -STEEPNESS, count) ** (-1 / STEEPNESS)
    angle = rng.uniform(0, 2 * np.pi, count)
    away = size[parent] * (0.5 * rng.uniform(0.9, 1.2, count) + REACH * rng.exponential(1, count))
    at = middle[parent] + away[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    turn = rng.uniform(0, np.pi) + rng.normal(0, STRIKE, count)
    seen = diameter / camera_distance(at, half)
    level = np.where((diameter < LARGEST_SHARE * size[parent]) & (seen > LEAST_ANGLE), seen > LEVEL_ANGLE, -1)
    groups = [np.flatnonzero(level == wanted) for wanted in (1, 0)]
    return [
        _laid(at[group], diameter[group], turn[group], albedo[parent[group]], int(level[group[0]]), height_at, rng)
        for group in groups
        if len(group)
    ]


def _laid(
    at: np.ndarray, diameter: np.ndarray, turn: np.ndarray, albedo: np.ndarray, level: int, height_at: Ground,
    rng: np.random.Generator,
) -> Plates:  # fmt: skip
    """Return chips at points (N, 2), of diameters, directions [rad] and brightness (N,), of one level of detail."""
    count = len(at)
    around = (np.arange(CORNERS) + rng.uniform(-0.4, 0.4, (count, CORNERS))) * 2 * np.pi / CORNERS
    narrow = np.sqrt(rng.uniform(*NARROW, (count, 1)))
    radius = diameter[:, None] / 2 * rng.uniform(0.7, 1.3, (count, CORNERS))
    u, v = radius * np.cos(around) / narrow, radius * np.sin(around) * narrow
    c, s = np.cos(turn)[:, None], np.sin(turn)[:, None]
    corners = at[:, None] + np.stack([c * u - s * v, s * u + c * v], axis=-1)
    shape = worn_outlines(corners, np.full(count, CORNERS), POINTS[level], 0.2, rng)
    ground, slope = ground_plane(at, diameter, height_at)
    tilt = np.tan(np.deg2rad(np.minimum(np.abs(rng.normal(0, TILT, count)), STEEPEST)))
    towards = rng.uniform(0, 2 * np.pi, count)
    steep = slope + tilt[:, None] * np.stack([np.cos(towards), np.sin(towards)], axis=1)
    edge = np.clip(rng.uniform(*THICK, count) * diameter, *EDGE)
    rise = ground[:, None] + np.einsum("npi,ni->np", shape - at[:, None], steep)
    above = edge - (rise - height_at(shape[..., 0], shape[..., 1])).max(axis=1)  # of the middle over the ground
    area, middle = area_and_centroid(shape, np.full(count, shape.shape[1]))
    return Plates(
        outline=shape, plane=np.column_stack([ground + above - np.einsum("ni,ni->n", steep, at), steep]),
        thickness=edge + ROOT, exposed=edge, undercut=rng.uniform(0, 0.1, count), bevel=0.1 * edge + 0.001,
        diameter=np.sqrt(4 / np.pi * np.maximum(area, 0)), middle=middle,
        albedo=albedo * np.clip(rng.normal(1, 0.08, count), 0.8, 1.2), level=level,
    )  # fmt: skip
