"""All figures of one method, summed up over pairs. The rules are those of m3depth.evaluation.metrics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from m3depth.evaluation.metrics import (
    DEPTH_TERMS,
    INTERVAL_EDGES,
    KINDS,
    NORMAL_TERMS,
    StereoTruth,
    angle_between,
    depth_terms,
    normal_terms,
    pixel_kinds,
)
from m3depth.evaluation.rock_scene import RockScene, rock_scene
from m3depth.evaluation.rock_scores import RockCounts
from m3depth.evaluation.running_sums import ErrorMap, RunningSums, SkyCounts
from m3depth.evaluation.sparsification import ConfidenceHistograms
from m3depth.stereo.pairs import MAX_DISPARITY
from m3depth.stereo.plane_normals import fitted_normals
from m3depth.stereo.prediction import Prediction

MAE, EPE = (DEPTH_TERMS.index(name) for name in ("mae", "epe"))
PAIR_FIGURES = ("abs_rel", "epe", "bad1", "normal_mean")  # figures that the record of a pair has by kind of pixel


@dataclass(frozen=True)
class ScoredPair:
    """A sample with what the scores of all methods share, computed once.

    Attributes:
        sample: The ground truth.
        max_disparity: Pixels of a larger true disparity [px] are scored separately, as "near".
    """

    sample: StereoTruth
    max_disparity: float = MAX_DISPARITY

    @cached_property
    def kinds(self) -> dict[str, np.ndarray]:
        """Masks (H, W) bool of the scored pixels by kind."""
        return pixel_kinds(self.sample, self.max_disparity)

    @cached_property
    def considered(self) -> np.ndarray:
        """Mask (H, W) bool of the pixels that are scored or near."""
        return self.kinds["all"] | self.kinds["near"]

    @cached_property
    def oriented(self) -> np.ndarray:
        """Mask (H, W) bool of the considered pixels whose true normal is known."""
        return self.considered & (np.einsum("ijk,ijk->ij", self.sample.normal, self.sample.normal) > 0.25)

    @cached_property
    def rocks(self) -> RockScene | None:
        """The rocks of the sample; None where the pose of the camera is unknown."""
        return rock_scene(self.sample)


class NormalScores:
    """Angles between predicted and true normals, by kind of pixel."""

    def __init__(self) -> None:
        self.kinds = {kind: RunningSums(NORMAL_TERMS, median=True) for kind in KINDS}

    def add(self, normal: np.ndarray, pair: ScoredPair) -> dict[str, dict[str, float]]:
        """Add a pair, and return its figures by kind of pixel. normal: (H, W, 3) as predicted."""
        angles = angle_between(normal[pair.oriented], pair.sample.normal[pair.oriented])
        return _add_kinds(self.kinds, normal_terms(angles), pair.kinds, pair.oriented)

    def state_dict(self) -> dict[str, Any]:
        """Return RunningSums.state_dict by kind."""
        return {kind: sums.state_dict() for kind, sums in self.kinds.items()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from a state, as RunningSums.load_state_dict does."""
        for kind, sums in self.kinds.items():
            sums.load_state_dict(state[kind])

    def result(self) -> dict[str, Any]:
        """Return RunningSums.result by kind."""
        return {kind: sums.result() for kind, sums in self.kinds.items()}


@dataclass
class Scores:
    """One method's figures.

    Attributes:
        fit: Whether the normals of planes fitted to its depth, as f B / depth, are scored as well.
        depth: Depth and disparity figures by kind of pixel.
        normal: Figures of its own normals.
        fitted: Figures of the fitted normals.
        intervals: Depth figures by interval of true depth.
        error_map: Counts of pixels by error and true depth.
        sky: Sky that is predicted near, and near ground that is predicted as sky.
        confidence: Errors by confidence.
        rocks: Rocks found and missed, and false obstacles.
    """

    fit: bool = False
    depth: dict[str, RunningSums] = field(default_factory=lambda: {kind: RunningSums(DEPTH_TERMS) for kind in KINDS})
    normal: NormalScores = field(default_factory=NormalScores)
    fitted: NormalScores = field(default_factory=NormalScores)
    intervals: list[RunningSums] = field(default_factory=lambda: [RunningSums(DEPTH_TERMS) for _ in INTERVAL_EDGES[1:]])
    error_map: ErrorMap = field(default_factory=ErrorMap)
    sky: SkyCounts = field(default_factory=SkyCounts)
    confidence: ConfidenceHistograms = field(default_factory=ConfidenceHistograms)
    rocks: RockCounts = field(default_factory=RockCounts)

    def add(self, prediction: Prediction, pair: ScoredPair) -> dict[str, Any]:
        """Score one pair.

        Args:
            prediction: Maps of the sample's size (m3depth.checked_inference.checked_prediction checks it).
            pair: The sample.

        Returns:
            The pair's figures over all scored pixels: the depth terms, "normal_<term>", and "fitted_normal_<term>" of
            the fitted normals. "kinds" holds those of PAIR_FIGURES for the other kinds of pixels that the pair has,
            "counts" its SkyCounts and RockCounts, and under "intervals" for each interval of true depth the number of
            scored pixels and the sum of their absolute errors [m].
        """
        sample, considered = pair.sample, pair.considered
        terms = depth_terms(
            prediction.depth[considered],
            prediction.disparity[considered],
            sample.depth[considered],
            sample.disparity[considered],
        )
        by_kind = _add_kinds(self.depth, terms, pair.kinds, considered)
        scored = pair.kinds["all"][considered]
        terms, true = terms[scored], sample.depth[pair.kinds["all"]]
        interval = np.searchsorted(INTERVAL_EDGES, true, side="left")
        ends = len(INTERVAL_EDGES) + 1
        count = np.bincount(interval, minlength=ends)
        totals = np.stack([np.bincount(interval, term, ends) for term in terms.T], axis=1)
        for index, sums in enumerate(self.intervals, start=1):
            sums.add_sums(totals[index], int(count[index]), terms[:0, 0])
        self.error_map.add(true, terms[:, MAE])
        self.confidence.add(prediction.confidence[pair.kinds["all"]], terms[:, EPE])
        if prediction.normal is not None:
            for kind, angular in self.normal.add(prediction.normal, pair).items():
                by_kind[kind] |= {f"normal_{name}": value for name, value in angular.items()}
        if self.fit:
            from_depth = sample.rig.depth_to_disparity(prediction.depth)  # the images' disparity may have an offset
            fitted = fitted_normals(from_depth, sample.rig.camera)
            fitted[np.isnan(prediction.depth)] = np.nan  # no plane is known there
            angular = self.fitted.add(fitted, pair)["all"]
            by_kind["all"] |= {f"fitted_normal_{name}": value for name, value in angular.items()}
        sky, rocks = SkyCounts(), RockCounts()
        sky.add(prediction.depth, np.asarray(sample.depth))
        if pair.rocks is not None:
            rocks.add(prediction, pair.rocks)
        self.sky.merge(sky)
        self.rocks.merge(rocks)
        kinds = {
            kind: {name: figures[name] for name in PAIR_FIGURES if name in figures}
            for kind, figures in by_kind.items()
            if kind != "all" and figures
        }
        by_depth = {"pixels": count[1:-1].tolist(), "absolute_error_m": totals[1:-1, MAE].tolist()}
        counts = {"sky": sky.state_dict(), "rocks": rocks.state_dict(), "intervals": by_depth}
        return {**by_kind["all"], "kinds": kinds, "counts": counts}

    def state_dict(self) -> dict[str, Any]:
        """Return the state of every part, by its name."""
        return {name: part.state_dict() for name, part in self._parts().items()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from a state, as RunningSums.load_state_dict does."""
        for name, part in self._parts().items():
            part.load_state_dict(state[name])

    def _parts(self) -> dict[str, Any]:
        return {
            **{f"depth {kind}": sums for kind, sums in self.depth.items()},
            **{f"interval {index}": sums for index, sums in enumerate(self.intervals)},
            "normal": self.normal, "fitted": self.fitted, "error_map": self.error_map, "sky": self.sky,
            "confidence": self.confidence, "rocks": self.rocks,
        }  # fmt: skip

    def result(self) -> dict[str, Any]:
        """Return all figures as plain numbers.

        Returns:
            "depth", "normal" and "fitted_normal" by kind (RunningSums.result), "intervals" of depth, "error_map",
            "sky", "sparsification" curves and "rocks".
        """
        edges = INTERVAL_EDGES.tolist()
        return {
            "depth": {kind: sums.result() for kind, sums in self.depth.items()},
            "normal": self.normal.result(),
            "fitted_normal": self.fitted.result(),
            "intervals": [
                {"from_m": low, "to_m": high, **sums.result()}
                for low, high, sums in zip(edges[:-1], edges[1:], self.intervals, strict=True)
            ],
            "error_map": self.error_map.result(),
            "sky": self.sky.result(),
            "sparsification": self.confidence.result(),
            "rocks": self.rocks.result(),
        }


def _add_kinds(
    sums_by_kind: Mapping[str, RunningSums], terms: np.ndarray, kinds: Mapping[str, np.ndarray], considered: np.ndarray
) -> dict[str, dict[str, float]]:
    """Add the terms at the pixels of the mask `considered` to the sums of each kind, and return the pair's figures."""
    members = np.stack([kinds[kind][considered] for kind in KINDS])
    totals = members.astype(np.float64) @ terms
    return {
        kind: sums_by_kind[kind].add_sums(total, int(mask.sum()), terms[mask, 0])
        for kind, mask, total in zip(KINDS, members, totals, strict=True)
    }
