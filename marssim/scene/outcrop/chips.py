"""Chips: thin pieces of 3 to 25 cm that split off slabs, beds and ledges. They lie flat around, partly under sand."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from marssim.scene.outcrop.config import Traits
from marssim.scene.outcrop.laying import worn_outlines
from marssim.scene.outcrop.plates import POINTS, Plates
from marssim.scene.outcrop.polygons import disc_diameter
from marssim.scene.outcrop.resting import Ground, camera_distance, rest
from marssim.scene.outcrop.shedding import Shedding, shed

SIZES = (0.03, 0.25)  # [m] diameters before their edges are worn
LAW = Shedding(sizes=SIZES, steepness=1.6, largest_share=0.5, most=40, reach=0.4)
MEAN_NUMBER = 10.0  # chips of a plate of 0.5 m at a density of fragments of 1
NUMBER_SPREAD = 1.2  # standard deviation of the logarithm of that number among plates
LEAST_ANGLE = 0.008  # [rad] angle under which a camera sees the smallest chips that are drawn
LEVEL_ANGLE = 0.03  # [rad] angular diameter from which on a chip has an outline of the middle level of detail
CORNERS = 6  # of a chip before its edges are worn
CORNER_SHIFT = 0.4  # largest shift of a corner around the chip, over the angle between corners
CORNER_RADII = (0.7, 1.3)  # distance of a corner from the middle, over the radius
WIDTH_RATIOS = (0.3, 0.85)  # width over length
ROUNDNESS = 0.2  # how round the corners of the roundest chips are, 0 to 1
STRIKE_SPREAD = 0.6  # [rad] standard deviation of the directions of chips: they split along the same joints
HEIGHT_RATIOS = (0.06, 0.22)  # height of the highest edge above the sand over the diameter
EDGE_HEIGHTS = (0.005, 0.04)  # [m] least and largest height of that edge
TILT_SPREAD, MAX_TILT = 8.0, 25.0  # [deg] standard deviation of the tilt, and largest tilt
ROOT = 0.02  # [m] depth of the sides below the ground
UNDERCUT = (0.0, 0.1)  # how far the bottom lies inside the outline, over the radius
BEVEL_SHARE, MIN_BEVEL = 0.1, 0.001  # width of the worn edge: over the height of the edge, and least addition [m]
ALBEDO_SPREAD, ALBEDO_RATIOS = 0.08, (0.8, 1.2)  # brightness over that of the plate: spread, and limits


def draw_chips(
    parents: Sequence[Plates], traits: Traits, half: float, height_at: Ground, most: int, rng: np.random.Generator
) -> list[Plates]:
    """Draw the chips of a scene.

    Args:
        parents: Slabs, the beds on them, and blocks of ledges.
        traits: What the scene drew.
        half: Half the side of the finely gridded square [m].
        height_at: Function of x, y [m] that returns the height of the ground [m].
        most: Largest number of chips. Those that look largest are kept.
        rng: Random generator.

    Returns:
        The chips that a camera can see, of each level of detail.
    """
    if not parents or traits.fragments == 0:
        return []
    middle, size, albedo = (
        np.concatenate([getattr(part, name) for part in parents]) for name in ("middle", "diameter", "albedo")
    )
    uneven = rng.lognormal(-0.5 * NUMBER_SPREAD**2, NUMBER_SPREAD, len(size))  # of mean 1
    pieces = shed(LAW, traits.fragments * MEAN_NUMBER * uneven, middle, size, rng)
    turn = rng.uniform(0, np.pi) + rng.normal(0, STRIKE_SPREAD, len(pieces))
    angle = pieces.diameter / camera_distance(pieces.xy, half)
    kept = np.argsort(-angle, kind="stable")[:most]
    groups = [(1, kept[angle[kept] > LEVEL_ANGLE])]
    groups.append((0, kept[(angle[kept] > LEAST_ANGLE) & (angle[kept] <= LEVEL_ANGLE)]))
    return [
        _laid(pieces.xy[g], pieces.diameter[g], turn[g], albedo[pieces.parent[g]], level, height_at, rng)
        for level, g in groups
        if len(g)
    ]


def _laid(
    at: np.ndarray, diameter: np.ndarray, turn: np.ndarray, albedo: np.ndarray, level: int, height_at: Ground,
    rng: np.random.Generator,
) -> Plates:  # fmt: skip
    """Return chips at points (N, 2), of diameters, directions [rad] and brightness (N,), of one level of detail."""
    count = len(at)
    shape = _outlines(at, diameter, turn, POINTS[level], rng)
    tilt = np.tan(np.deg2rad(np.minimum(np.abs(rng.normal(0, TILT_SPREAD, count)), MAX_TILT)))
    towards = rng.uniform(0, 2 * np.pi, count)
    lean = tilt[:, None] * np.stack([np.cos(towards), np.sin(towards)], axis=1)
    edge = np.clip(rng.uniform(*HEIGHT_RATIOS, count) * diameter, *EDGE_HEIGHTS)
    lie = rest(shape, at, diameter, lean, edge, height_at)
    chips = Plates(
        outline=shape, plane=lie.plane, thickness=edge + ROOT, exposed=edge, middle=lie.middle, level=level,
        undercut=rng.uniform(*UNDERCUT, count), bevel=BEVEL_SHARE * edge + MIN_BEVEL, diameter=disc_diameter(lie.area),
        albedo=albedo * np.clip(rng.normal(1, ALBEDO_SPREAD, count), *ALBEDO_RATIOS),
    )  # fmt: skip
    return chips.chosen(lie.area > 0)


def _outlines(
    at: np.ndarray, diameter: np.ndarray, turn: np.ndarray, points: int, rng: np.random.Generator
) -> np.ndarray:
    """Return outlines (N, points, 2) of chips; see _laid."""
    count = len(at)
    around = np.arange(CORNERS) + rng.uniform(-CORNER_SHIFT, CORNER_SHIFT, (count, CORNERS))
    around *= 2 * np.pi / CORNERS
    narrow = np.sqrt(rng.uniform(*WIDTH_RATIOS, (count, 1)))
    radius = diameter[:, None] / 2 * rng.uniform(*CORNER_RADII, (count, CORNERS))
    u, v = radius * np.cos(around) / narrow, radius * np.sin(around) * narrow
    c, s = np.cos(turn)[:, None], np.sin(turn)[:, None]
    corners = at[:, None] + np.stack([c * u - s * v, s * u + c * v], axis=-1)
    return worn_outlines(corners, np.full(count, CORNERS), points, ROUNDNESS, rng)
