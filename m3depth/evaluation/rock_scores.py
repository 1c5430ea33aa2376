"""What depth makes of the rocks, which decide a drive and which the means over all pixels hide.

Everything is told from the ground truth's own ground, so that no obstacle detector stands between a depth map and its
score (python -m envs.rocks asks the navigator's map instead):

- A rock's height is that of its visible points above the plane through the ground around it, along gravity. Rocks of
  0.1 m and more, of 30 pixels and more, up to 15 m away count, by the height of their highest point;
  one whose top (below) is not above that plane, in a hollow, is none.
- It is found if the predicted top, the 95th percentile over its pixels, stands at least half as high as the true top,
  the same percentile. Pixels whose depth is off by more than a quarter show no rock at its place: they count as ground.
- Stereo cannot measure a rock of which the right eye sees fewer than 30 pixels: those that both eyes see are told
  apart.
- Seen falsely is a connected region away from every rock (5 px), in the sky too, whose predicted points stand 0.2 m and
  more above the true ground below them, up to 15 m away, and that is as large as 0.1 m x 0.1 m at its depth.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple, Protocol

import cv2
import numpy as np

from m3depth.stereo.prediction import Prediction
from marssim.base.camera import MAX_DEPTH, StereoRig, rotate

HEIGHT_EDGES = (0.1, 0.2, 0.3, 0.5, np.inf)  # [m]
RANGE_EDGES = (0.0, 4.0, 8.0, MAX_DEPTH)  # [m] along the ground
OBSTACLE = 0.2  # [m] what stands as high as this is one
LEAST_PIXELS = 30
TOP = 95.0  # [%] percentile of the heights of a rock's pixels that is called its top
AWAY = 0.25  # relative depth error from which a pixel shows something else
ROCK_RIM = 5  # [px] beside a rock, where a blurred outline is no obstacle of its own
FALSE_EDGE = 0.1  # [m] edge of the square that a false obstacle has to fill
CELL = 0.1  # [m] of the ground's map
REACH = 20.0  # [m] half its edge
RING = 0.75  # [m] of ground around a rock that its plane is fitted to


class RockTruth(Protocol):
    """The fields of a sample that are read. meta holds "pose", (4, 4) left camera to world, z up."""

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
    """pixels: (N,) flat indices; plane: height of the ground is plane @ (x, y, 1); height, top, away: see above [m];
    both_eyes: whether the right eye sees enough of it."""

    pixels: np.ndarray
    plane: np.ndarray
    height: float
    top: float
    away: float
    both_eyes: bool


@dataclass
class RockScene:
    """The rocks and the ground of one sample, in axes that are level and stand in the left eye.

    rays: (H, W, 3) float32 of depth 1; true_depth: (H, W) [m]; focal: [px], of the rows; ground: (n, n) [m] height of
    each cell, [iy, ix]; beside: (H, W) bool, on a rock or within ROCK_RIM.
    """

    rays: np.ndarray
    true_depth: np.ndarray
    focal: float
    ground: np.ndarray
    beside: np.ndarray
    rocks: list[SeenRock]

    def heights(self, points: np.ndarray) -> np.ndarray:
        """(N,) [m] of points (N, 3), in these axes, above the ground below them; points beyond REACH are 0 m high."""
        cell = _cells(points)
        return np.where(cell >= 0, points[:, 2] - self.ground.ravel()[cell], 0.0)


def rock_scene(sample: RockTruth) -> RockScene | None:
    """Measure the rocks of a sample; None if it records no pose, or shows no ground."""
    pose = getattr(sample, "meta", {}).get("pose")
    if pose is None:
        return None
    camera = sample.rig.camera
    rays = rotate(camera.rays(), np.asarray(pose, dtype=float)[:3, :3]).astype(np.float32)
    on_rock = sample.rock > 0
    seen = np.isfinite(sample.depth) & (sample.depth > 0)
    known = _mean_heights(rays[seen & ~on_rock] * sample.depth[seen & ~on_rock][:, None])
    if np.isnan(known).all():
        return None
    reach = np.ones((2 * ROCK_RIM + 1,) * 2, np.uint8)
    beside = cv2.dilate(on_rock.astype(np.uint8), reach) > 0
    rocks = _measure(sample, rays, known, on_rock & seen & (sample.depth <= 1.5 * MAX_DEPTH))
    return RockScene(rays, sample.depth, camera.fy, _nearest(known), beside, rocks)


def _cells(points: np.ndarray) -> np.ndarray:
    """(N,) flat index of the cell that each point (N, 3) lies in; -1 outside."""
    n = round(2 * REACH / CELL)
    index = np.floor((points[:, :2] + REACH) / CELL).astype(np.int64)
    inside = ((index >= 0) & (index < n)).all(axis=1)
    return np.where(inside, index[:, 1] * n + index[:, 0], -1)


def _mean_heights(points: np.ndarray) -> np.ndarray:
    """(n, n) mean height of the points (N, 3) in each cell; NaN where there is none."""
    n = round(2 * REACH / CELL)
    cell = _cells(points)
    inside = cell >= 0
    count = np.bincount(cell[inside], minlength=n * n)
    total = np.bincount(cell[inside], points[inside, 2], minlength=n * n)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan).reshape(n, n)


def _nearest(heights: np.ndarray) -> np.ndarray:
    """The map with every gap filled by the nearest known cell."""
    gap = np.isnan(heights).astype(np.uint8)
    labels = cv2.distanceTransformWithLabels(gap, cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL)[1]
    value = np.zeros(labels.max() + 1)
    value[labels[gap == 0]] = heights[gap == 0]
    return value[labels]


def _measure(sample: RockTruth, rays: np.ndarray, ground: np.ndarray, at: np.ndarray) -> list[SeenRock]:
    rocks = []
    for pixels in _by_label(np.where(at, sample.rock, 0)):
        if len(pixels) < LEAST_PIXELS:
            continue
        points = rays.reshape(-1, 3)[pixels] * sample.depth.ravel()[pixels][:, None]
        middle = points[:, :2].mean(axis=0)
        away = float(np.hypot(*middle))
        if away > RANGE_EDGES[-1]:
            continue
        radius = float(np.hypot(*(points[:, :2] - middle).T).max())
        plane = _plane_around(ground, middle, radius + RING)
        if plane is None:
            continue
        height = points[:, 2] - (points[:, :2] @ plane[:2] + plane[2])
        top = float(np.percentile(height, TOP))
        if height.max() >= HEIGHT_EDGES[0] and top > 0:
            both = int((~sample.occluded.ravel()[pixels]).sum()) >= LEAST_PIXELS
            rocks.append(SeenRock(pixels, plane, float(height.max()), top, away, both))
    return rocks


def _by_label(labels: np.ndarray) -> list[np.ndarray]:
    """The flat indices of the pixels of each label but 0, in the order of the labels. labels: (H, W) int."""
    flat = np.flatnonzero(labels)
    if not len(flat):
        return []
    order = np.argsort(labels.ravel()[flat], kind="stable")
    start = np.unique(labels.ravel()[flat][order], return_index=True)[1]
    return np.split(flat[order], start[1:])


def _plane_around(ground: np.ndarray, middle: np.ndarray, radius: float) -> np.ndarray | None:
    """Least-squares plane (slope x, slope y, height at 0) through the known cells of a disc; None without any.

    Slopes are held back by a tenth of the cells' weight at a metre, so that ground on a line gives no wild plane.
    """
    n = len(ground)
    low, high = (np.clip(np.floor((middle + s * radius + REACH) / CELL).astype(int), 0, n - 1) for s in (-1, 1))
    part = ground[low[1] : high[1] + 1, low[0] : high[0] + 1]
    iy, ix = np.nonzero(np.isfinite(part))
    x, y = ((i + start + 0.5) * CELL - REACH - m for i, start, m in zip((ix, iy), low, middle))
    near = np.hypot(x, y) <= radius
    if not near.any():
        return None
    x, y, z = x[near], y[near], part[iy[near], ix[near]]
    held = np.sqrt(0.1 * len(z)) * np.eye(3)[:2]
    system = np.vstack([np.column_stack([x, y, np.ones(len(z))]), held])
    slope_x, slope_y, level = np.linalg.lstsq(system, np.append(z, [0, 0]), rcond=None)[0]
    return np.array([slope_x, slope_y, level - slope_x * middle[0] - slope_y * middle[1]])


def predicted_tops(scene: RockScene, depth: np.ndarray) -> np.ndarray:
    """(number of rocks,) [m] how high each rock's top stands by a predicted depth (H, W)."""
    rays, flat, true = scene.rays.reshape(-1, 3), depth.ravel(), scene.true_depth.ravel()
    tops = np.zeros(len(scene.rocks))
    for i, rock in enumerate(scene.rocks):
        z = flat[rock.pixels].astype(float)
        with np.errstate(invalid="ignore"):
            there = np.abs(z - true[rock.pixels]) <= AWAY * true[rock.pixels]
        points = rays[rock.pixels] * np.where(there, z, 0)[:, None]
        height = points[:, 2] - (points[:, :2] @ rock.plane[:2] + rock.plane[2])
        tops[i] = np.percentile(np.where(there, height, 0.0), TOP)
    return tops


def false_obstacles(scene: RockScene, depth: np.ndarray) -> list[tuple[float, float]]:
    """(height, distance along the ground) [m] of every obstacle that a predicted depth (H, W) shows where none is."""
    with np.errstate(invalid="ignore"):
        look = np.isfinite(depth) & (depth > 0) & ~scene.beside
    # Within REACH all round; farther points are none of ours.
    look &= depth * np.hypot(scene.rays[..., 0], scene.rays[..., 1]) <= RANGE_EDGES[-1]
    points = scene.rays[look] * depth[look][:, None]
    above = np.zeros(depth.shape, np.float32)
    above[look] = scene.heights(points)
    count, label = cv2.connectedComponents((above >= OBSTACLE).astype(np.uint8), connectivity=8)
    if count == 1:
        return []
    found = []
    for pixels in _by_label(label):
        z = float(np.median(depth.ravel()[pixels]))
        if len(pixels) >= (FALSE_EDGE * scene.focal / z) ** 2:
            across = scene.rays.reshape(-1, 3)[pixels, :2] * depth.ravel()[pixels][:, None]
            distance = float(np.median(np.hypot(*across.T)))
            found.append((float(np.percentile(above.ravel()[pixels], TOP)), distance))
    return found


class RockOutcome(NamedTuple):
    """What became of one rock: its height and distance [m], whether it was found, the error of its height [m], and
    whether both eyes see it."""

    height: float
    away: float
    found: bool
    error: float
    both_eyes: bool = True


@dataclass
class RockTally:
    """Rocks found and missed, and obstacles that are none, over many images. false: (height, distance) of these [m]."""

    images: int = 0
    rocks: list[RockOutcome] = field(default_factory=list)
    false: list[tuple[float, float]] = field(default_factory=list)

    def add(self, prediction: Prediction, scene: RockScene) -> None:
        """Judge one prediction."""
        self.images += 1
        tops = predicted_tops(scene, prediction.depth)
        for rock, top in zip(scene.rocks, tops, strict=True):
            found = bool(top >= rock.top / 2)
            self.rocks.append(RockOutcome(rock.height, rock.away, found, float(top - rock.top), rock.both_eyes))
        self.false += false_obstacles(scene, prediction.depth)

    def state_dict(self) -> dict[str, Any]:
        """As m3depth.evaluation.running_sums.Tally.state_dict."""
        return {"images": self.images, "rocks": self.rocks, "false": self.false}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """As m3depth.evaluation.running_sums.Tally.load_state_dict."""
        self.images = state["images"]
        self.rocks = [RockOutcome(*rock) for rock in state["rocks"]]
        self.false = [(height, away) for height, away in state["false"]]

    def result(self) -> dict[str, Any]:
        """{"images", "false": all of them, "bins": figures by height and distance, "standing_0.2_m_within_8_m":
        figures}; {} without images."""
        if not self.images:
            return {}
        bins = [
            self.figures(low, high, near, far)
            for low, high in pairwise(HEIGHT_EDGES)
            for near, far in pairwise(RANGE_EDGES)
        ]
        return {
            "images": self.images,
            "false": len(self.false),
            "bins": bins,
            "standing_0.2_m_within_8_m": self.figures(OBSTACLE, np.inf, 0.0, 8.0),
        }

    def figures(self, low: float, high: float, near: float, far: float) -> dict[str, Any]:
        """Of heights and distances from the first up to the second [m].

        rocks, found; found_share and the height's error over the rocks found [m], its median magnitude and its median
        with sign, None without any; the first three again of those that both eyes see; false, false_per_image.
        """
        rocks = [r for r in self.rocks if low <= r.height < high and near <= r.away < far]
        errors = np.array([r.error for r in rocks if r.found])
        both = [r.found for r in rocks if r.both_eyes]
        false = count_between(self.false, low, high, near, far)
        return {
            "height_from_m": low,
            "height_to_m": high,
            "range_from_m": near,
            "range_to_m": far,
            "rocks": len(rocks),
            "found": len(errors),
            "found_share": len(errors) / len(rocks) if rocks else None,
            "both_eyes": len(both),
            "both_eyes_found": sum(both),
            "both_eyes_share": sum(both) / len(both) if both else None,
            "height_error_m": float(np.median(np.abs(errors))) if len(errors) else None,
            "height_bias_m": float(np.median(errors)) if len(errors) else None,
            "false": false,
            "false_per_image": false / self.images,
        }


def count_between(seen: Iterable[tuple[float, float]], low: float, high: float, near: float, far: float) -> int:
    """How many of (height, distance) [m] lie in low <= height < high and near <= distance < far."""
    return sum(low <= height < high and near <= away < far for height, away in seen)
