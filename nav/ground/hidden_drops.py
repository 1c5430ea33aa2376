"""Negative obstacles: ground that an edge hides, and that lies lower than the ground before the edge.

Along an image column, from the rover outwards, the points of even ground follow each other closely. Where the next
point lies much farther away, the ground between the two is hidden: it falls more steeply than the line of sight. It is
the shadow of something that stands out, if the ground behind the gap goes on as before it. Else it is a possible drop
(Heckman, Lalonde, Vandapel and Hebert 2007, "Potential negative obstacle detection by occlusion labeling").
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from marssim.base.camera import StereoRig

LOOK_BACK = np.linspace(0.2, 1.2, 6)  # [m] before an edge, where the ground is looked up
STEEPEST_GROUND = 0.4  # largest descent of the ground before an edge that is taken to go on behind it, as a tangent
SPACING = 0.05  # [m] between two places on hidden ground
BEYOND = 100.0  # [m] depth that stands for infinity


@dataclass(frozen=True)
class HiddenDropConfig:
    """What counts as a possible drop."""

    sight_deg: float = 15.0
    """Lines of sight that descend by less than this hide ordinary slopes too, and show no drop [deg]. On level ground
    and from 1.2 m, this is a range of 4.5 m."""
    least_gap: float = 0.4
    """Least length of hidden ground [m]. Wheels roll over shorter gaps."""
    least_drop: float = 0.3
    """Least height of the ground before the gap above the ground behind it [m]: RoverSpec.obstacle_height."""
    reach: float = 1.0
    """Ground that is hidden farther behind the edge stays unknown [m]."""
    skipped_rows: float = 1 / 64
    """Most image rows without valid depth between both sides of a gap, as a share of the image: depth is uncertain at
    an edge."""


def hidden_drops(
    depth: np.ndarray,
    valid: np.ndarray,
    columns: np.ndarray,
    rig: StereoRig,
    pose: np.ndarray,
    config: HiddenDropConfig,
    ground_at: Callable[[np.ndarray], np.ndarray],
) -> tuple[np.ndarray, np.ndarray]:
    """Find the possible drops that a depth map shows.

    Args:
        depth: (H, W) depth [m] along the optical axis; inf shows that the ground in front of it is hidden.
        valid: (H, W) bool, the pixels whose depth may be used.
        columns: (c,) image columns that are used.
        rig: The cameras at the size of depth.
        pose: (4, 4) left camera to world.
        config: What counts.
        ground_at: Returns the known heights of the ground (...) [m] at world positions (..., 2) [m], NaN for unknown.

    Returns:
        World positions (m, 2) [m] on hidden ground, SPACING apart along each column, and their columns (m,).
    """
    column, near, far = _gaps(depth, valid, columns, rig, pose, config)
    away = near[:, :2] - pose[:2, 3]
    away /= np.hypot(*away.T)[:, None]
    gap = np.hypot(*(far - near)[:, :2].T)
    expected = _ground_behind(near, away, gap, ground_at)
    drop = expected - far[:, 2] >= config.least_drop
    column, near, away, gap = column[drop], near[drop], away[drop], gap[drop]
    along = np.arange(SPACING, config.reach, SPACING)
    places = near[:, None, :2] + along[:, None] * away[:, None]
    hidden = along < gap[:, None]
    return places[hidden], np.broadcast_to(column[:, None], hidden.shape)[hidden]


def _gaps(
    depth: np.ndarray,
    valid: np.ndarray,
    columns: np.ndarray,
    rig: StereoRig,
    pose: np.ndarray,
    config: HiddenDropConfig,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the gaps between points that follow each other in a column: the column (g,), and the world positions of
    the point before the gap and of the point behind it, each (g, 3) [m].
    """
    camera = rig.camera
    below = depth[::-1, columns].T  # a row for each column, from the nearest ground on
    i, j = np.nonzero(valid[::-1, columns].T)
    z = np.minimum(below[i, j], BEYOND)
    ray = np.stack(
        [(columns[i] - camera.cx) / camera.fx, (camera.height - 1 - j - camera.cy) / camera.fy, 0 * z + 1], 1
    )
    offset = (ray * z[:, None]) @ pose[:3, :3].T
    away = np.hypot(offset[:, 0], offset[:, 1])
    rows = 1 + max(2, round(config.skipped_rows * camera.height))
    gap = (np.diff(i) == 0) & (np.diff(j) <= rows) & (np.diff(away) >= config.least_gap)
    gap &= (z[:-1] < BEYOND) & (-offset[:-1, 2] >= np.tan(np.deg2rad(config.sight_deg)) * away[:-1])
    at = np.flatnonzero(gap)
    return columns[i[at]], offset[at] + pose[:3, 3], offset[at + 1] + pose[:3, 3]


def _ground_behind(
    near: np.ndarray, away: np.ndarray, gap: np.ndarray, ground_at: Callable[[np.ndarray], np.ndarray]
) -> np.ndarray:
    """Return the height that the ground has behind each gap (g,) [m] if it goes on as before the gap.

    The lowest known ground before the edge counts, so that the top of a rock does not, and its descent goes on.

    Args:
        near: (g, 3) the points before the gaps [m].
        away: (g, 2) horizontal unit vectors away from the camera.
        gap: (g,) lengths of the gaps [m].
        ground_at: As of hidden_drops.
    """
    height = ground_at(near[:, None, :2] - LOOK_BACK[:, None] * away[:, None])
    known = np.isfinite(height)
    number = np.maximum(known.sum(axis=1), 1)[:, None]
    height = np.where(known, height, 0.0)
    back = np.where(known, LOOK_BACK - (known * LOOK_BACK).sum(axis=1, keepdims=True) / number, 0.0)
    descent = (back * height).sum(axis=1) / np.maximum((back**2).sum(axis=1), 1e-6)
    descent = np.clip(descent, 0.0, STEEPEST_GROUND)
    lowest = np.where(known, height, near[:, 2:]).min(axis=1)
    return lowest - descent * (gap + LOOK_BACK[0])
