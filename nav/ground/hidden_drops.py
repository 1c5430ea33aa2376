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
from marssim.base.command.limits import check_least, check_range

LOOK_BACK = np.linspace(0.2, 2.0, 10)  # [m] before an edge, where the ground is looked up
LATER, EARLIER = np.triu_indices(len(LOOK_BACK), 1)  # the pairs of these places
STEEPEST_GROUND = 0.4  # largest descent of the ground before an edge that is taken to go on behind it, as a tangent
SPACING = 0.05  # [m] between two places on hidden ground
BEYOND = 100.0  # [m] depth that stands for infinity


@dataclass(frozen=True)
class HiddenDropConfig:
    """What counts as a possible drop."""

    sight_deg: float = 15.0
    """Lines of sight at less than this angle to the ground before an edge hide ordinary slopes too, and show no drop
    [deg]. On level ground and from 1.2 m, this is a range of 4.5 m."""
    least_gap: float = 0.4
    """Least length of hidden ground [m]. Wheels roll over shorter gaps."""
    least_drop: float = 0.3
    """Least height of the ground before the gap above the ground behind it [m]: RoverSpec.obstacle_height."""
    reach: float = 1.0
    """Ground that is hidden farther behind the edge stays unknown [m]."""
    skipped_rows: float = 1 / 64
    """Most image rows without valid depth between both sides of a gap, as a share of the image: depth is uncertain at
    an edge."""

    def __post_init__(self) -> None:
        check_range(self, sight_deg=(0, 90), skipped_rows=(0, 1))
        check_least(self, least_gap=0, least_drop=0, reach=0)


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
    distance = np.hypot(*away.T)
    away /= distance[:, None]
    gap = np.hypot(*(far - near)[:, :2].T)
    height, descent = _ground_before(near, away, ground_at)
    angle = np.arctan2(pose[2, 3] - near[:, 2], distance) - np.arctan(descent)
    drop = (height - descent * gap - far[:, 2] >= config.least_drop) & (angle >= np.deg2rad(config.sight_deg))
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
    # The ground before an edge only lessens the angle, as its descent is never negative.
    gap &= (z[:-1] < BEYOND) & (-offset[:-1, 2] >= np.tan(np.deg2rad(config.sight_deg)) * away[:-1])
    at = np.flatnonzero(gap)
    return columns[i[at]], offset[at] + pose[:3, 3], offset[at + 1] + pose[:3, 3]


def _ground_before(
    near: np.ndarray, away: np.ndarray, ground_at: Callable[[np.ndarray], np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the straight line that the ground follows to each edge, as its height at the edge (g,) [m] and its descent
    (g,), at least 0.

    The descent is the median over all pairs of places (Theil and Sen), which a rock on some of them does not change.
    The line touches the ground from below, so that the top of a rock does not count.

    Args:
        near: (g, 3) the points before the gaps [m].
        away: (g, 2) horizontal unit vectors away from the camera.
        ground_at: As of hidden_drops.
    """
    height = ground_at(near[:, None, :2] - LOOK_BACK[:, None] * away[:, None])
    slopes = (height[:, EARLIER] - height[:, LATER]) / (LOOK_BACK[EARLIER] - LOOK_BACK[LATER])
    slopes[~np.isfinite(slopes).any(axis=1)] = 0.0
    descent = np.clip(np.nanmedian(slopes, axis=1), 0.0, STEEPEST_GROUND)
    return np.fmin.reduce(np.column_stack([height - descent[:, None] * LOOK_BACK, near[:, 2]]), axis=1), descent
