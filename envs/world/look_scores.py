"""Scores of the depth of one look of a drive against the truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from envs.world.perception import Sight
from m3depth.evaluation.metrics import capped_depth, has_depth
from m3depth.evaluation.rock_scene import rock_scene
from m3depth.evaluation.rock_scores import HIGH_AND_NEAR, RockCounts
from m3depth.evaluation.running_sums import SkyCounts
from m3depth.stereo.pairs import MAX_DISPARITY
from m3depth.stereo.prediction import Prediction
from marssim.base.camera import MAX_DEPTH, MIN_DEPTH, StereoRig


def in_range(depth: np.ndarray) -> np.ndarray:
    """Return which depths (...) [m] are scored: those of 0.5 m to 15 m."""
    return (depth >= MIN_DEPTH) & (depth <= MAX_DEPTH)


def scored_pixels(sight: Sight) -> np.ndarray:
    """Return at which pixels (H, W) bool the depth of a look is scored: true depths of 0.5 m to 15 m, and disparities
    of at most 192 px.

    Raises:
        ValueError: The true depth of the look is not known.
    """
    if sight.true_depth is None:
        raise ValueError("the true depth of the look is not known")
    return in_range(sight.true_depth) & (sight.rig.depth_to_disparity(sight.true_depth) <= MAX_DISPARITY)


def look_abs_rel(sight: Sight) -> float | None:
    """Return the mean |Z - Z*| / Z* of one look over the scored_pixels.

    By the rules of m3depth.evaluation.metrics unknown depth counts as 80 m. It is None with the ground truth, and where
    nothing is in range.
    """
    if sight.true_depth is None or sight.true_depth is sight.depth:
        return None
    scored = scored_pixels(sight)
    true = sight.true_depth[scored].astype(np.float64)
    return float(np.mean(np.abs(capped_depth(sight.depth[scored]) - true) / true)) if scored.any() else None


def is_blind(sight: Sight) -> bool:
    """Return whether there was ground within range, and no depth was measured of any of it."""
    if sight.true_depth is None:
        return False
    near = in_range(sight.true_depth)
    return bool(near.any() and not has_depth(sight.depth[near]).any())


class RockErrors(NamedTuple):
    """What a depth gets wrong about the rocks that stand 0.2 m and more within 8 m, which decide a drive."""

    rocks: int
    """Number of rocks in view."""
    missed: int
    """Number of those that the depth does not show at half their height."""
    false: int
    """Number of such obstacles in the depth where there is none."""


@dataclass(frozen=True)
class _RockView:
    """The truth of a look, as rock_scene reads it."""

    depth: np.ndarray
    rock: np.ndarray
    occluded: np.ndarray
    rig: StereoRig
    meta: dict[str, Any]


def look_rock_errors(sight: Sight) -> RockErrors | None:
    """Return the errors about the rocks of one look, by the rules of m3depth.evaluation.rock_scores.

    It is None with the ground truth. A look that shows no ground has no rocks.
    """
    if sight.true_depth is None or sight.true_surface is None or sight.occluded is None:
        return None
    truth = _RockView(sight.true_depth, sight.true_surface, sight.occluded, sight.rig, {"pose": sight.pose})
    scene = rock_scene(truth)
    if scene is None:
        return RockErrors(0, 0, 0)
    counts = RockCounts()
    counts.add(Prediction(sight.depth, sight.rig.depth_to_disparity(sight.depth), None, sight.confidence), scene)
    figures = counts.result()[HIGH_AND_NEAR]
    return RockErrors(figures["rocks"], figures["rocks"] - figures["found"], figures["false"])


class GroundAsSky(NamedTuple):
    """How much of the near ground a depth takes for sky, which the navigator reads as free."""

    near_ground: int
    """Number of pixels with a true depth below 8 m."""
    as_sky: int
    """Number of those that the depth takes for sky."""


def look_ground_as_sky(sight: Sight) -> GroundAsSky | None:
    """Return how much of the near ground one look takes for sky, as m3depth.evaluate counts it; None with the ground
    truth."""
    if sight.true_depth is None or sight.true_depth is sight.depth:
        return None
    counts = SkyCounts()
    counts.add(sight.depth, sight.true_depth)
    return GroundAsSky(counts.ground, counts.ground_as_sky)
