"""Rocks in the navigator's map of one frame: found, missed or left unknown; and displaced or false obstacles.

The needs of a rover's driver decide what counts:

- A rock that only the left eye sees cannot be measured by stereo, as it lies outside the overlap on which flight
  software works. It counts as missed, but is reported separately. So is a missed rock at a place where the map shows
  nothing: the rover does not enter unseen ground.
- Stereo places things no better than an error of one pixel of disparity: 0.2 m along the ray at 6 m, 0.9 m at 12 m,
  with NaTeCam. A rock within that distance (and 0.3 m across) of the place where the map shows it, and at least half as
  high, is a rock to drive around, which is placed again when the rover is nearer. It counts as displaced, not as false.
- A pebble explains no obstacle. If every rock pixel did, nine of ten obstacles at random places would be explained, so
  densely are rocks strewn.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np

from m3depth.evaluation.rock_scene import RockScene, SeenRock
from m3depth.evaluation.rock_scores import RockCounts, RockOutcome, count_between
from marssim.base.camera import StereoRig
from marssim.base.rover_spec import ZHURONG
from nav import ElevationMap, TraversabilityConfig, assess
from nav.ground.elevation import ElevationConfig

BESIDE = 0.3  # [m] around a rock, within which what stands out belongs to the rock
RANGE_ERROR = 1.0  # [px] error of the disparity within which a rock counts as displaced
RIM = 0.5  # [m] before the end of the map's range, where only parts of rocks may be on it
RULES = f"""\
Rocks, their heights and distances are those of m3depth.evaluation.rock_scores, to
{ElevationConfig.max_range - RIM:g} m of depth; the map ends at {ElevationConfig.max_range:g} m. A rock is found if a
cell on it, or beside it, stands out by that much; its height is that of the highest such cell. A rock is left unknown
if it is not found and the map knows less than half of its cells. A connected patch of such cells belongs to no rock if
nothing within 0.3 m truly stands at least half as high. The patch is displaced if such a thing stands within 0.3 m and
a range error of 1 px of disparity, and else false. Edges of slabs are those of m3depth.evaluation.rock_scene, and are
found as rocks are; their slabs count among the rocks too. The rows of ground_truth show the best that the map can
do."""


@dataclass(frozen=True)
class FrameMap:
    """The navigator's map of one depth map."""

    elevation: ElevationMap
    """The elevation map."""
    step: np.ndarray
    """(n, n) height that each cell stands out of the ground [m]; NaN where unknown."""


@dataclass(frozen=True)
class TrueRocks:
    """Where the rocks truly are, in the cells of a FrameMap."""

    cells: list[np.ndarray]
    """For each rock its cells, (n, n) bool."""
    edge_cells: list[np.ndarray]
    """For each edge of a slab its cells, (n, n) bool."""
    height: np.ndarray
    """(n, n) true height above the ground [m], from the rock pixels and the map of the true depth; -1 where unknown."""
    fb: float
    """Focal length x baseline [px m]."""


def true_rocks(scene: RockScene, true: FrameMap, on_rock: np.ndarray, fb: float) -> TrueRocks:
    """Return where the rocks truly are.

    Args:
        scene: The rocks that the frame shows.
        true: The map of the true depth.
        on_rock: (H, W) bool, the pixels of all rocks, small ones included.
        fb: Focal length x baseline [px m].
    """
    elevation = true.elevation
    points = scene.rays.reshape(-1, 3) * np.where(np.isfinite(scene.true_depth), scene.true_depth, 0).reshape(-1, 1)
    cells, edge_cells = (
        [_cells_of(elevation, points[rock.pixels, :2]) for rock in rocks] for rocks in (scene.rocks, scene.slab_edges)
    )
    rock_points = points[np.flatnonzero(on_rock & np.isfinite(scene.true_depth))]
    height = np.nan_to_num(true.step, nan=-1.0)
    index = elevation.cell_of(rock_points[:, :2])
    inside = ((index >= 0) & (index < elevation.n)).all(axis=1)
    above = scene.heights(rock_points)
    np.maximum.at(height, (index[inside, 1], index[inside, 0]), above[inside])
    return TrueRocks(cells, edge_cells, height, fb)


def _cells_of(elevation: ElevationMap, xy: np.ndarray) -> np.ndarray:
    """Return the cells in which places (N, 2) [m] lie: (n, n) bool."""
    mask = np.zeros((elevation.n, elevation.n), bool)
    index = elevation.cell_of(xy)
    index = index[((index >= 0) & (index < elevation.n)).all(axis=1)]
    mask[index[:, 1], index[:, 0]] = True
    return mask


def frame_map(depth: np.ndarray, confidence: np.ndarray | None, rig: StereoRig, turn: np.ndarray) -> FrameMap:
    """Return the navigator's map of one depth map.

    Args:
        depth: (H, W) depth [m].
        confidence: (H, W) in [0, 1], or None.
        rig: The cameras.
        turn: (3, 3) rotation from the left camera to level axes; the camera stands at (0, 0, 0).
    """
    pose = np.eye(4)
    pose[:3, :3] = turn
    elevation = ElevationMap()
    elevation.integrate(depth, confidence, rig, pose)
    return FrameMap(elevation, assess(elevation, ZHURONG, TraversabilityConfig()).step)


@dataclass
class MapRockCounts(RockCounts):
    """Counts of a map, beside those that every depth has."""

    displaced: list[tuple[float, float]] = field(default_factory=list)
    """(height, distance) [m] of each obstacle that is a rock, but not at its place."""
    unknown: list[tuple[float, float]] = field(default_factory=list)
    """(height, distance) [m] of each missed rock whose place is unknown in the map."""

    def result(self) -> dict[str, Any]:
        """Return the result of RockCounts, with the number of all displaced obstacles."""
        counts = super().result()
        return {**counts, "displaced": len(self.displaced)} if counts else {}

    def figures(self, low: float, high: float, near: float, far: float) -> dict[str, Any]:
        """Return the figures of RockCounts, with the numbers of unknown and displaced.

        Args:
            low: Least height [m].
            high: Height at which the interval ends [m].
            near: Least distance [m].
            far: Distance at which the interval ends [m].
        """
        lists = {"unknown": self.unknown, "displaced": self.displaced}
        counts = {name: count_between(places, low, high, near, far) for name, places in lists.items()}
        return {**super().figures(low, high, near, far), **counts}


def count_rocks(counts: MapRockCounts, shown: FrameMap, scene: RockScene, truth: TrueRocks, least: float) -> None:
    """Add what one map shows to the counts.

    Args:
        counts: The counts.
        shown: The map.
        scene: The rocks that the frame shows.
        truth: Where the rocks truly are.
        least: Height from which a cell is an obstacle [m].
    """
    counts.images += 1
    config = shown.elevation.config
    with np.errstate(invalid="ignore"):
        stands = shown.step >= least
    for rock, rock_cells in zip(scene.rocks, truth.cells, strict=True):
        outcome = _outcome(shown, scene, rock, rock_cells, stands)
        if outcome is None:
            continue
        counts.rocks.append(outcome)
        if not outcome.found and shown.elevation.known[rock_cells].mean() < 0.5:
            counts.unknown.append((rock.height, rock.distance))
    edges = (_outcome(shown, scene, *edge, stands) for edge in zip(scene.slab_edges, truth.edge_cells, strict=True))
    counts.edges += [outcome for outcome in edges if outcome is not None]
    surroundings = np.ones((2 * round(BESIDE / config.cell) + 1,) * 2, np.uint8)
    with np.errstate(invalid="ignore"):
        false = stands & ~(cv2.dilate(truth.height, surroundings) >= shown.step / 2)
    count, label = cv2.connectedComponents(false.astype(np.uint8), connectivity=8)
    x, y = shown.elevation.centres()
    distance = np.hypot(x[None, :], y[:, None])
    for number in range(1, count):
        patch = label == number
        height = float(shown.step[patch].max())
        places = counts.displaced if _is_displaced(shown.elevation, patch, height, truth) else counts.false
        places.append((height, float(np.median(distance[patch]))))


def _outcome(
    shown: FrameMap, scene: RockScene, rock: SeenRock, rock_cells: np.ndarray, stands: np.ndarray
) -> RockOutcome | None:
    """Return the outcome of a rock, or of an edge of a slab; None where it lies at the end of the map's range.

    Args:
        shown: The map.
        scene: The rocks that the frame shows.
        rock: One of them, or of their edges.
        rock_cells: (n, n) bool, its cells.
        stands: (n, n) bool, the cells that are obstacles.
    """
    if np.median(scene.true_depth.ravel()[rock.pixels]) >= shown.elevation.config.max_range - RIM:
        return None
    cells = _wider(rock_cells, 1)
    detected = bool((stands & cells).any())
    height = float(np.nanmax(shown.step[cells])) if detected else np.nan
    return RockOutcome(rock.height, rock.distance, detected, height - rock.height, rock.both_eyes)


def _is_displaced(elevation: ElevationMap, patch: np.ndarray, height: float, truth: TrueRocks) -> bool:
    """Return whether something at least half as high truly stands within the range error of a patch (n, n) bool."""
    iy, ix = np.nonzero(patch)
    x, y = elevation.centres()
    xy = np.column_stack([x[ix], y[iy]])
    distance = np.hypot(*xy.T)
    # dZ = Z^2 / (f B) dd; distance along the ground for Z, which it exceeds a little towards the image's sides.
    error = RANGE_ERROR * distance / truth.fb
    along = 1 + np.arange(-1, 1.01, 0.02)[:, None] * error
    near = _cells_of(elevation, (along[..., None] * xy).reshape(-1, 2))
    return bool(truth.height[_wider(near, round(BESIDE / elevation.config.cell))].max() >= height / 2)


def _wider(mask: np.ndarray, cells: int) -> np.ndarray:
    """Return a mask that is wider by a number of cells to each side."""
    return cv2.dilate(mask.astype(np.uint8), np.ones((2 * cells + 1,) * 2, np.uint8)) > 0
