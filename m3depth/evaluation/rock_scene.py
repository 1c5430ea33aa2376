"""The rocks and the ground of one sample, measured on its ground truth.

A rock's height is that of its visible points above the plane through the ground around it, along gravity. A rock is
measured if its highest point stands 0.1 m or more above that plane, and its top (the 95th percentile over its pixels)
above it, if it has 30 pixels or more, and if it is up to 15 m away.

Slabs, blocks of ledges and fragments are rocks here. In a pavement of slabs, most of a slab is low, and what stands
out is an edge that may reach over several of them. So edges are measured too: an edge of a slab is a connected region
(8 neighbours) of pixels on slabs and ledges that stand 0.1 m or more above the ground around their slab or block. The
rules for rocks then hold for the region: 30 pixels, 15 m, and a highest point 0.1 m above the plane through the ground
around the region, which is its height.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Protocol

import cv2
import numpy as np

from m3depth.evaluation.surfaces import on_slab
from marssim.base.camera import MAX_DEPTH, StereoRig
from marssim.base.pose import rotate

LEAST_HEIGHT = 0.1  # [m] lower rocks are not measured
LEAST_PIXELS = 30  # rocks of fewer pixels are not measured
TOP = 95.0  # [%] percentile of the heights of a rock's pixels that is called its top
ROCK_RIM = 5  # [px] beside a rock or the rover, where a blurred outline is no obstacle
CELL = 0.1  # [m] edge of a cell of the ground's map
REACH = 20.0  # [m] half the edge of the ground's map
RING = 0.75  # [m] width of the ring of ground around a rock that its plane is fitted to


class RockTruth(Protocol):
    """The fields of a sample that are read; meta holds "pose", (4, 4) from the left camera to the world, z up."""

    @property
    def depth(self) -> np.ndarray: ...
    @property
    def rock(self) -> np.ndarray: ...
    @property
    def occluded(self) -> np.ndarray: ...
    @property
    def rig(self) -> StereoRig: ...
    @property
    def meta(self) -> dict[str, Any]: ...


@dataclass(frozen=True)
class SeenRock:
    """A rock, or an edge of a slab, as the left eye sees it.

    Attributes:
        pixels: (N,) flat indices of its pixels.
        plane: (3,) the ground around it has the height plane @ (x, y, 1) [m].
        height: Height of its highest point above the ground [m].
        top: The 95th percentile of its pixels' heights [m].
        distance: Distance along the ground [m].
        both_eyes: Whether the right eye sees 30 pixels of it or more.
    """

    pixels: np.ndarray
    plane: np.ndarray
    height: float
    top: float
    distance: float
    both_eyes: bool


@dataclass
class RockScene:
    """The rocks and the ground of one sample, in level axes with their origin in the left eye.

    Attributes:
        rays: (H, W, 3) float32 rays of depth 1.
        true_depth: (H, W) depth [m].
        focal: Focal length of the rows [px].
        ground: (n, n) height of each cell of the ground [m], [iy, ix].
        near_rock: (H, W) bool, pixels on a rock or on the rover that carries the cameras, or within ROCK_RIM of either.
        rocks: The rocks that are measured.
        slab_edges: The edges of slabs and ledges that are measured.
    """

    rays: np.ndarray
    true_depth: np.ndarray
    focal: float
    ground: np.ndarray
    near_rock: np.ndarray
    rocks: list[SeenRock]
    slab_edges: list[SeenRock] = field(default_factory=list)

    def heights(self, points: np.ndarray) -> np.ndarray:
        """Return the heights (N,) [m] of points (N, 3), in these axes, above the ground below them.

        Points beyond REACH have a height of 0.
        """
        cell = _cells(points)
        return np.where(cell >= 0, points[:, 2] - self.ground.ravel()[cell], 0.0)


def rock_scene(sample: RockTruth) -> RockScene | None:
    """Return the rocks and the ground of a sample; None if it records no pose, or shows no ground."""
    pose = getattr(sample, "meta", {}).get("pose")
    if pose is None:
        return None
    camera = sample.rig.camera
    rays = rotate(camera.rays(), np.asarray(pose, dtype=float)[:3, :3]).astype(np.float32)
    on_rock = sample.rock > 0
    visible = np.isfinite(sample.depth) & (sample.depth > 0)
    open_ground = visible & (sample.rock == 0)
    ground = _mean_heights(rays[open_ground] * sample.depth[open_ground][:, None])
    if np.isnan(ground).all():
        return None
    reach = np.ones((2 * ROCK_RIM + 1,) * 2, np.uint8)
    on_rover = visible & (sample.rock < 0)  # in maps of surface ids, the sky is below 0 too
    near_rock = cv2.dilate((on_rock | on_rover).astype(np.uint8), reach) > 0
    rocks, edges = _measure(sample, rays, ground, on_rock & visible & (sample.depth <= 1.5 * MAX_DEPTH))
    return RockScene(rays, sample.depth, camera.fy, _nearest(ground), near_rock, rocks, edges)


def _cells(points: np.ndarray) -> np.ndarray:
    """Return the flat index (N,) of the cell that each point (N, 3) lies in; -1 outside."""
    n = round(2 * REACH / CELL)
    index = np.floor((points[:, :2] + REACH) / CELL).astype(np.int64)
    inside = ((index >= 0) & (index < n)).all(axis=1)
    return np.where(inside, index[:, 1] * n + index[:, 0], -1)


def _mean_heights(points: np.ndarray) -> np.ndarray:
    """Return the mean height (n, n) [m] of the points (N, 3) in each cell; NaN where there is none."""
    n = round(2 * REACH / CELL)
    cell = _cells(points)
    inside = cell >= 0
    count = np.bincount(cell[inside], minlength=n * n)
    total = np.bincount(cell[inside], points[inside, 2], minlength=n * n)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan).reshape(n, n)


def _nearest(heights: np.ndarray) -> np.ndarray:
    """Return the map with every gap filled by the nearest known cell."""
    gap = np.isnan(heights).astype(np.uint8)
    labels = cv2.distanceTransformWithLabels(gap, cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL)[1]
    value = np.zeros(labels.max() + 1)
    value[labels[gap == 0]] = heights[gap == 0]
    return value[labels]


def _measure(
    sample: RockTruth, rays: np.ndarray, ground: np.ndarray, on_rock: np.ndarray
) -> tuple[list[SeenRock], list[SeenRock]]:
    """Return the rocks, and the edges of slabs.

    Args:
        sample: The sample.
        rays: (H, W, 3) rays of depth 1, level axes.
        ground: (n, n) known heights of the ground [m], NaN elsewhere.
        on_rock: (H, W) bool, the pixels of what may be measured.
    """
    rocks = []
    above = np.zeros(on_rock.size)  # height of each pixel above the ground around its rock [m]
    for pixels in pixels_by_label(np.where(on_rock, sample.rock, 0)):
        rock, above[pixels] = _as_rock(sample, rays, ground, pixels)
        rocks += [] if rock is None else [rock]
    standing = (above.reshape(on_rock.shape) >= LEAST_HEIGHT) & on_slab(sample)
    regions = cv2.connectedComponents(standing.astype(np.uint8), connectivity=8)[1]
    edges = [_as_rock(sample, rays, ground, pixels)[0] for pixels in pixels_by_label(regions)]
    return rocks, [edge for edge in edges if edge is not None]


def _as_rock(
    sample: RockTruth, rays: np.ndarray, ground: np.ndarray, pixels: np.ndarray
) -> tuple[SeenRock | None, np.ndarray | float]:
    """Measure pixels as one rock.

    Args:
        sample: The sample.
        rays: (H, W, 3) rays of depth 1, level axes.
        ground: (n, n) known heights of the ground [m], NaN elsewhere.
        pixels: (N,) flat indices.

    Returns:
        The rock, None where the rules leave it out; and the heights of the pixels above the ground around them, (N,)
        [m], 0 where they are too few, too far away or without ground around.
    """
    if len(pixels) < LEAST_PIXELS:
        return None, 0.0
    points = rays.reshape(-1, 3)[pixels] * sample.depth.ravel()[pixels][:, None]
    middle = points[:, :2].mean(axis=0)
    distance = float(np.hypot(*middle))
    if distance > MAX_DEPTH:
        return None, 0.0
    radius = float(np.hypot(*(points[:, :2] - middle).T).max())
    plane = _plane_around(ground, middle, radius + RING)
    if plane is None:
        return None, 0.0
    height = points[:, 2] - (points[:, :2] @ plane[:2] + plane[2])
    if height.max() < LEAST_HEIGHT:  # most of them: a percentile takes time
        return None, height
    top = float(np.percentile(height, TOP))
    if top <= 0:
        return None, height
    both = int((~sample.occluded.ravel()[pixels]).sum()) >= LEAST_PIXELS
    return SeenRock(pixels, plane, float(height.max()), top, distance, both), height


def pixels_by_label(labels: np.ndarray) -> list[np.ndarray]:
    """Return the flat indices of the pixels of each label but 0, in the order of the labels, (H, W) int."""
    flat = np.flatnonzero(labels)
    if not len(flat):
        return []
    order = np.argsort(labels.ravel()[flat], kind="stable")
    start = np.unique(labels.ravel()[flat][order], return_index=True)[1]
    return np.split(flat[order], start[1:])


def _plane_around(ground: np.ndarray, middle: np.ndarray, radius: float) -> np.ndarray | None:
    """Fit a plane (slope x, slope y, height at 0) to the known cells of a disc by least squares; None without any.

    The slopes are damped by a tenth of the cells' weight at a metre, so that ground on a line gives no wild plane.
    """
    n = len(ground)
    across, up = (
        slice(*(min(max(math.floor((m + s * radius + REACH) / CELL), 0), n - 1) + (s > 0) for s in (-1, 1)))
        for m in middle.tolist()
    )
    part = ground[up, across]
    iy, ix = np.nonzero(np.isfinite(part))
    x, y = ((i + side.start + 0.5) * CELL - REACH - m for i, side, m in zip((ix, iy), (across, up), middle))
    near = np.hypot(x, y) <= radius
    count = np.count_nonzero(near)
    if not count:
        return None
    system, heights = np.zeros((count + 2, 3)), np.zeros(count + 2)
    system[:count, 0], system[:count, 1], system[:count, 2] = x[near], y[near], 1
    heights[:count] = part[iy[near], ix[near]]
    system[count, 0] = system[count + 1, 1] = math.sqrt(0.1 * count)
    slope_x, slope_y, level = np.linalg.lstsq(system, heights, rcond=None)[0]
    return np.array([slope_x, slope_y, level - slope_x * middle[0] - slope_y * middle[1]])
