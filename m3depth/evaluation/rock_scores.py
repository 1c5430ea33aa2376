"""Scores of the rocks, which decide a drive and which the means over all pixels hide.

Rocks and ground are those of the ground truth (m3depth.evaluation.rock_scene), so that no obstacle detector stands
between a depth map and its score (`python -m envs.rocks` scores the navigator's map instead):

- A rock is found if the predicted top, the 95th percentile over its pixels, stands at least half as high as the true
  top, the same percentile. Pixels whose depth is off by more than a quarter show no rock at its place: they count as
  ground.
- Edges of slabs (m3depth.evaluation.rock_scene) are found in the same way, and counted beside the rocks. Their slabs
  and ledges also count among the rocks, each as a whole.
- Stereo cannot measure a rock of which the right eye sees fewer than 30 pixels: the rocks that both eyes see are also
  counted separately.
- A false obstacle is a connected region away from every rock and from the rover that carries the cameras (5 px), in the
  sky too, whose predicted points stand 0.2 m and more above the true ground below them, up to 15 m away, and that is as
  large as 0.1 m x 0.1 m at its depth.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple

import cv2
import numpy as np

from m3depth.evaluation.rock_scene import LEAST_HEIGHT, TOP, RockScene, SeenRock, pixels_by_label
from m3depth.stereo.prediction import Prediction
from marssim.base.camera import MAX_DEPTH

HEIGHT_EDGES = (LEAST_HEIGHT, 0.2, 0.3, 0.5, np.inf)  # [m] of the intervals of height that have figures
RANGE_EDGES = (0.0, 4.0, 8.0, MAX_DEPTH)  # [m] of the intervals of distance along the ground
HIGH_AND_NEAR = "standing_0.2_m_within_8_m"  # name of the figures of what decides a drive
OBSTACLE = 0.2  # [m] height from which something counts as an obstacle
OTHER_SURFACE = 0.25  # relative depth error from which a pixel shows something else than the rock
FALSE_EDGE = 0.1  # [m] edge of the square that a false obstacle has to fill


def predicted_tops(scene: RockScene, rocks: Sequence[SeenRock], depth: np.ndarray) -> np.ndarray:
    """Return how high the top of each rock stands by a predicted depth (H, W) [m]; (number of rocks,) [m].

    Args:
        scene: The sample.
        rocks: Its rocks, or its edges of slabs.
        depth: (H, W) predicted depth [m].
    """
    rays, flat, true = scene.rays.reshape(-1, 3), depth.ravel(), scene.true_depth.ravel()
    tops = np.zeros(len(rocks))
    for i, rock in enumerate(rocks):
        z = flat[rock.pixels].astype(float)
        with np.errstate(invalid="ignore"):
            at_the_rock = np.abs(z - true[rock.pixels]) <= OTHER_SURFACE * true[rock.pixels]
        points = rays[rock.pixels] * np.where(at_the_rock, z, 0)[:, None]
        height = points[:, 2] - (points[:, :2] @ rock.plane[:2] + rock.plane[2])
        tops[i] = np.percentile(np.where(at_the_rock, height, 0.0), TOP)
    return tops


def false_obstacles(scene: RockScene, depth: np.ndarray) -> list[tuple[float, float]]:
    """Return the height and distance along the ground [m] of every obstacle that exists only in a predicted depth.

    Args:
        scene: The true rocks and ground.
        depth: (H, W) predicted depth [m].
    """
    with np.errstate(invalid="ignore"):
        within = np.isfinite(depth) & (depth > 0) & ~scene.near_rock
    within &= depth * np.hypot(scene.rays[..., 0], scene.rays[..., 1]) <= RANGE_EDGES[-1]
    points = scene.rays[within] * depth[within][:, None]
    above = np.zeros(depth.shape, np.float32)
    above[within] = scene.heights(points)
    count, label = cv2.connectedComponents((above >= OBSTACLE).astype(np.uint8), connectivity=8)
    if count == 1:
        return []
    obstacles = []
    for pixels in pixels_by_label(label):
        z = float(np.median(depth.ravel()[pixels]))
        if len(pixels) >= (FALSE_EDGE * scene.focal / z) ** 2:
            across = scene.rays.reshape(-1, 3)[pixels, :2] * depth.ravel()[pixels][:, None]
            distance = float(np.median(np.hypot(*across.T)))
            obstacles.append((float(np.percentile(above.ravel()[pixels], TOP)), distance))
    return obstacles


class RockOutcome(NamedTuple):
    """The outcome of one rock, or of one edge of a slab.

    Attributes:
        height: Its height [m].
        distance: Its distance along the ground [m].
        found: Whether it was found.
        error: Error of the height of its top [m].
        both_eyes: Whether the right eye sees enough of it.
    """

    height: float
    distance: float
    found: bool
    error: float
    both_eyes: bool = True


@dataclass
class RockCounts:
    """Rocks found and missed, and false obstacles, over many images.

    Attributes:
        images: Number of images.
        rocks: The outcome of every rock.
        edges: The outcome of every edge of a slab.
        false: Height and distance [m] of every false obstacle.
    """

    images: int = 0
    rocks: list[RockOutcome] = field(default_factory=list)
    edges: list[RockOutcome] = field(default_factory=list)
    false: list[tuple[float, float]] = field(default_factory=list)

    def add(self, prediction: Prediction, scene: RockScene) -> None:
        """Add the outcomes of one prediction.

        Args:
            prediction: The predicted maps.
            scene: The true rocks and ground of the same image.
        """
        self.images += 1
        self.rocks += _outcomes(scene, scene.rocks, prediction.depth)
        self.edges += _outcomes(scene, scene.slab_edges, prediction.depth)
        self.false += false_obstacles(scene, prediction.depth)

    def merge(self, other: RockCounts) -> None:
        """Add the counts of other images, of the same class."""
        for name, value in vars(other).items():
            setattr(self, name, getattr(self, name) + value)

    def state_dict(self) -> dict[str, Any]:
        """Return the state, as RunningSums.state_dict does."""
        return {"images": self.images, "rocks": self.rocks, "edges": self.edges, "false": self.false}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from a state, as RunningSums.load_state_dict does."""
        self.images = state["images"]
        self.rocks = [RockOutcome(*rock) for rock in state["rocks"]]
        self.edges = [RockOutcome(*edge) for edge in state["edges"]]
        self.false = [(height, distance) for height, distance in state["false"]]

    def result(self) -> dict[str, Any]:
        """Return the figures.

        Returns:
            {} without images. Otherwise "images", "false" (the number of false obstacles), "bins" (figures by height
            and distance), "standing_0.2_m_within_8_m" (figures of what decides a drive), and "slab_edges" with "bins"
            and "standing_0.2_m_within_8_m" of the edges of slabs.
        """
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
            HIGH_AND_NEAR: self.figures(OBSTACLE, np.inf, 0.0, 8.0),
            "slab_edges": {
                "bins": [
                    outcome_figures(self.edges, low, high, near, far)
                    for low, high in pairwise(HEIGHT_EDGES)
                    for near, far in pairwise(RANGE_EDGES)
                ],
                HIGH_AND_NEAR: outcome_figures(self.edges, OBSTACLE, np.inf, 0.0, 8.0),
            },
        }

    def figures(self, low: float, high: float, near: float, far: float) -> dict[str, Any]:
        """Return the figures of an interval of heights and one of distances.

        Args:
            low: Least height [m].
            high: Height at which the interval ends [m].
            near: Least distance [m].
            far: Distance at which the interval ends [m].

        Returns:
            Those of outcome_figures; "false", "false_per_image".
        """
        false = count_between(self.false, low, high, near, far)
        figures = outcome_figures(self.rocks, low, high, near, far)
        return {**figures, "false": false, "false_per_image": false / self.images}


def outcome_figures(
    outcomes: Iterable[RockOutcome], low: float, high: float, near: float, far: float
) -> dict[str, Any]:
    """Return the figures of the rocks, or edges of slabs, in an interval of heights and one of distances.

    Args:
        outcomes: Of all of them.
        low: Least height [m].
        high: Height at which the interval ends [m].
        near: Least distance [m].
        far: Distance at which the interval ends [m].

    Returns:
        The intervals; "rocks", "found", "found_share"; the same of the rocks that both eyes see; "height_error_m" and
        "height_bias_m", the median of the error's magnitude and of the error over the rocks found. Shares and errors
        are None without any rocks.
    """
    rocks = [r for r in outcomes if low <= r.height < high and near <= r.distance < far]
    errors = np.array([r.error for r in rocks if r.found])
    both = [r.found for r in rocks if r.both_eyes]
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
    }


def _outcomes(scene: RockScene, rocks: Sequence[SeenRock], depth: np.ndarray) -> list[RockOutcome]:
    """Return the outcome of each rock of a sample in a predicted depth (H, W) [m]."""
    tops = predicted_tops(scene, rocks, depth)
    return [
        RockOutcome(rock.height, rock.distance, bool(top >= rock.top / 2), float(top - rock.top), rock.both_eyes)
        for rock, top in zip(rocks, tops, strict=True)
    ]


def count_between(obstacles: Iterable[tuple[float, float]], low: float, high: float, near: float, far: float) -> int:
    """Return how many of (height, distance) [m] lie in low <= height < high and near <= distance < far.

    Args:
        obstacles: (height, distance) [m] of each obstacle.
        low: Least height [m].
        high: Height at which the interval ends [m].
        near: Least distance [m].
        far: Distance at which the interval ends [m].
    """
    return sum(low <= height < high and near <= distance < far for height, distance in obstacles)
