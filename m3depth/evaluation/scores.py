"""Everything that is summed up about one method. The rules are those of m3depth.evaluation.metrics."""

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
from m3depth.evaluation.rock_scores import RockScene, RockTally, rock_scene
from m3depth.evaluation.running_sums import ErrorMap, SkyTally, Tally
from m3depth.evaluation.sparsification import ConfidenceTally
from m3depth.stereo.pairs import MAX_DISPARITY
from m3depth.stereo.plane_normals import fitted_normals
from m3depth.stereo.prediction import Prediction

MAE, EPE = (DEPTH_TERMS.index(name) for name in ("mae", "epe"))


@dataclass(frozen=True)
class ScoredPair:
    """A sample, and what all methods are scored on alike, worked out once.

    sample: with ground truth; max_disparity [px]: nearer pixels are scored apart, as "near".
    """

    sample: StereoTruth
    max_disparity: float = MAX_DISPARITY

    @cached_property
    def kinds(self) -> dict[str, np.ndarray]:
        """(H, W) bool by kind."""
        return pixel_kinds(self.sample, self.max_disparity)

    @cached_property
    def looked_at(self) -> np.ndarray:
        """(H, W) bool: scored, or near."""
        return self.kinds["all"] | self.kinds["near"]

    @cached_property
    def oriented(self) -> np.ndarray:
        """(H, W) bool: looked at, and its true normal is known."""
        return self.looked_at & (np.einsum("ijk,ijk->ij", self.sample.normal, self.sample.normal) > 0.25)

    @cached_property
    def rocks(self) -> RockScene | None:
        """None where the pose of the camera is not known."""
        return rock_scene(self.sample)


class NormalScores:
    """Angles between normals, by kind of pixel."""

    def __init__(self) -> None:
        self.kinds = {kind: Tally(NORMAL_TERMS, median=True) for kind in KINDS}

    def add(self, normal: np.ndarray, pair: ScoredPair) -> dict[str, float]:
        """normal: (H, W, 3). Returns the pair's figures over all scored pixels."""
        angles = angle_between(normal[pair.oriented], pair.sample.normal[pair.oriented])
        return _add_kinds(self.kinds, normal_terms(angles), pair.kinds, pair.oriented)

    def state_dict(self) -> dict[str, Any]:
        """Tally.state_dict by kind."""
        return {kind: tally.state_dict() for kind, tally in self.kinds.items()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """As Tally.load_state_dict."""
        for kind, tally in self.kinds.items():
            tally.load_state_dict(state[kind])

    def result(self) -> dict[str, Any]:
        """Tally.result by kind."""
        return {kind: tally.result() for kind, tally in self.kinds.items()}


@dataclass
class Scores:
    """One method's figures. fit: score the normals that planes fitted to its disparity give as well."""

    fit: bool = False
    depth: dict[str, Tally] = field(default_factory=lambda: {kind: Tally(DEPTH_TERMS) for kind in KINDS})
    normal: NormalScores = field(default_factory=NormalScores)
    fitted: NormalScores = field(default_factory=NormalScores)
    intervals: list[Tally] = field(default_factory=lambda: [Tally(DEPTH_TERMS) for _ in INTERVAL_EDGES[1:]])
    error_map: ErrorMap = field(default_factory=ErrorMap)
    sky: SkyTally = field(default_factory=SkyTally)
    confidence: ConfidenceTally = field(default_factory=ConfidenceTally)
    rocks: RockTally = field(default_factory=RockTally)

    def add(self, prediction: Prediction, pair: ScoredPair) -> dict[str, float]:
        """Score one pair. Returns the pair's figures over all scored pixels: the depth terms, and "normal_<term>".

        Raises ValueError if the prediction's maps are not of the sample's size.
        """
        sample, at = pair.sample, pair.looked_at
        _check_shapes(prediction, sample.depth.shape)
        terms = depth_terms(prediction.depth[at], prediction.disparity[at], sample.depth[at], sample.disparity[at])
        figures = _add_kinds(self.depth, terms, pair.kinds, at)
        scored = pair.kinds["all"][at]
        terms, true = terms[scored], sample.depth[pair.kinds["all"]]
        interval = np.searchsorted(INTERVAL_EDGES, true, side="left")
        ends = len(INTERVAL_EDGES) + 1
        count = np.bincount(interval, minlength=ends)
        sums = np.stack([np.bincount(interval, term, ends) for term in terms.T], axis=1)
        for index, tally in enumerate(self.intervals, start=1):
            tally.add_sums(sums[index], int(count[index]), terms[:0, 0])
        self.error_map.add(true, terms[:, MAE])
        self.confidence.add(prediction.confidence[pair.kinds["all"]], terms[:, EPE])
        if prediction.normal is not None:
            angular = self.normal.add(prediction.normal, pair)
            figures |= {f"normal_{name}": value for name, value in angular.items()}
        if self.fit:
            self.fitted.add(fitted_normals(prediction.disparity, sample.rig.camera), pair)
        self.sky.add(prediction.depth, np.isposinf(sample.depth))  # NaN is unknown
        if pair.rocks is not None:
            self.rocks.add(prediction, pair.rocks)
        return figures

    def state_dict(self) -> dict[str, Any]:
        """The state of every tally in here, by its name."""
        return {name: tally.state_dict() for name, tally in self._tallies().items()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """As Tally.load_state_dict."""
        for name, tally in self._tallies().items():
            tally.load_state_dict(state[name])

    def _tallies(self) -> dict[str, Any]:
        return {
            **{f"depth {kind}": tally for kind, tally in self.depth.items()},
            **{f"interval {index}": tally for index, tally in enumerate(self.intervals)},
            "normal": self.normal, "fitted": self.fitted, "error_map": self.error_map, "sky": self.sky,
            "confidence": self.confidence, "rocks": self.rocks,
        }  # fmt: skip

    def result(self) -> dict[str, Any]:
        """Plain numbers: depth, normal and fitted_normal by kind (Tally.result), the depth intervals, the error map,
        the sky, the sparsification curves, the rocks."""
        edges = INTERVAL_EDGES.tolist()
        return {
            "depth": {kind: tally.result() for kind, tally in self.depth.items()},
            "normal": self.normal.result(),
            "fitted_normal": self.fitted.result(),
            "intervals": [
                {"from_m": low, "to_m": high, **tally.result()}
                for low, high, tally in zip(edges[:-1], edges[1:], self.intervals, strict=True)
            ],
            "error_map": self.error_map.result(),
            "sky": self.sky.result(),
            "sparsification": self.confidence.result(),
            "rocks": self.rocks.result(),
        }


def _check_shapes(prediction: Prediction, shape: tuple[int, ...]) -> None:
    expected = {"depth": shape, "disparity": shape, "confidence": shape}
    if prediction.normal is not None:
        expected["normal"] = (*shape, 3)
    for name, wanted in expected.items():
        found = getattr(prediction, name).shape
        if found != wanted:
            raise ValueError(f"predicted {name} is {found}, the sample asks for {wanted}")


def _add_kinds(
    tallies: Mapping[str, Tally], terms: np.ndarray, kinds: Mapping[str, np.ndarray], at: np.ndarray
) -> dict[str, float]:
    """Add the terms, given at the pixels of mask `at`, to the tallies; returns the figures of "all"."""
    of_kind = np.stack([kinds[kind][at] for kind in KINDS])
    sums = of_kind.astype(np.float64) @ terms
    return {
        kind: tallies[kind].add_sums(total, int(mask.sum()), terms[mask, 0])
        for kind, mask, total in zip(KINDS, of_kind, sums, strict=True)
    }["all"]
