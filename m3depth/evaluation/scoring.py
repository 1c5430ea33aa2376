"""The scoring of several methods on the same pairs, in one pass over them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import astuple, dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from m3depth.checked_inference import errors_at, inferred
from m3depth.datasets.labels import advice
from m3depth.datasets.pair_files import SHIFT_KEY
from m3depth.estimator import Estimator, for_pair, gets_truth
from m3depth.evaluation.cost import Cost, measured
from m3depth.evaluation.example import Example
from m3depth.evaluation.recorded_maps import RecordedPredictions
from m3depth.evaluation.report import depth_range_text
from m3depth.evaluation.resume import SavedState
from m3depth.evaluation.scores import NormalScores, ScoredPair, Scores
from m3depth.stereo.degradation import Degradation
from m3depth.stereo.pairs import MAX_DISPARITY, StereoPairs, pair_name, scene_name, scored_depths, spread
from m3depth.stereo.plane_normals import fitted_normals
from m3depth.stereo.prediction import Prediction
from m3depth.stereo.rows import align_rows, columns_in_given_image
from marssim.base.camera import StereoRig
from marssim.base.command.signals import stop_on_signal
from marssim.base.command.wording import counted
from marssim.base.files.json_file import DatasetError

NOT_FIGURES = {"seconds", "kinds", "counts"}  # entries of a method's record of a pair that have no median over images
RESERVED = ("index", "pair", "scene")  # fields of a pair's record that no method may be called

# What can be scored: an estimator that is run, or maps that another program wrote.
Method = Estimator | RecordedPredictions


@dataclass
class Evaluation:
    """The result of `evaluate`.

    Attributes:
        results: By method, Scores.result() with "median_image" (the median over images of the image's figures),
            "seconds" (median and mean per pair) and "memory_mib" (the most that the whole process held, and that was
            held on a GPU). These two are None for predictions that were read. "gets_truth": whether the true depth was
            given to the method. "normals_are_fitted": whether its own normals are those of planes fitted to its depth.
            "as_recorded": whether its maps were read though the images of the others were changed.
        pairs: A record per pair, with the figures of each method.
        true_depth_normals: Figures of the normals that planes fitted to the true depth give, by kind.
        examples: Pairs for the figures.
        worst: The pairs in which the first method's mean disparity error is largest, the largest first.
    """

    results: dict[str, dict[str, Any]]
    pairs: list[dict[str, Any]] = field(default_factory=list)
    true_depth_normals: dict[str, Any] = field(default_factory=dict)
    examples: list[Example] = field(default_factory=list)
    worst: list[Example] = field(default_factory=list)

    @property
    def scored_pixels(self) -> int:
        """Number of scored pixels, with those of large disparities, which is the same for every method."""
        depth = next(iter(self.results.values()))["depth"]
        return int(depth["all"]["pixels"] + depth["near"]["pixels"])

    def near_share(self) -> float:
        """Return the share of the scored pixels whose disparity is so large that they are scored apart, as near."""
        near = next(iter(self.results.values()))["depth"]["near"]["pixels"]
        return float(near / max(self.scored_pixels, 1))

    def nothing_scored(self, dataset: StereoPairs) -> str:
        """Return the message on an evaluation of these pairs that scored no pixel: why, and what to check."""
        has_sky = any(result["sky"]["pixels"] for result in self.results.values())
        return (
            f"no pixel of {counted(len(self.pairs), 'pair')} is scored, since none has a "
            f"{depth_range_text(scored_depths(dataset))}; {advice(dataset, has_sky)}"
        )


class Scoring:
    """Methods that are scored a pair at a time, in a state that can be saved and loaded.

    Attributes:
        dataset: The pairs, with ground truth.
        methods: The methods, by the name of their column.
        degradation: Applied to the images first; None for none.
        seed: Seed of the degradation's noise.
        max_disparity: Pixels of a larger true disparity [px] are scored separately.
        align_rows: Whether rows that lie apart are aligned before an estimator sees them (m3depth.stereo.rows).
        pairs: The records so far, in the order in which the pairs came.
    """

    def __init__(
        self,
        dataset: StereoPairs,
        methods: Mapping[str, Method],
        degradation: Degradation | None,
        seed: int,
        max_disparity: float,
        align_rows: bool = False,
    ) -> None:
        self.dataset, self.methods, self.align_rows = dataset, methods, align_rows
        self.degradation, self.seed, self.max_disparity = degradation, seed, max_disparity
        self.pairs: list[dict[str, Any]] = []
        self._scores = {
            name: Scores(fit=not getattr(method, "normals_are_fitted", False)) for name, method in methods.items()
        }
        self._true_depth_normals = NormalScores()
        self._costs: dict[str, list[Cost]] = {name: [] for name in methods}
        self._warm: set[str] = set()

    def add(self, index: int) -> Example:
        """Score every method on the pair of an index, and append its record to `pairs`. Raises as `evaluate` does."""
        example, costs = self.predicted(index)
        pair = ScoredPair(example.truth, self.max_disparity)
        record: dict[str, Any] = {
            "index": index, "pair": pair_name(self.dataset, index), "scene": scene_name(self.dataset, index),
        }  # fmt: skip
        for name, prediction in example.predictions.items():
            try:
                record[name] = self._scores[name].add(prediction, pair)
            except DatasetError as error:
                raise DatasetError(f"pair {record['pair']}: {error}") from None
            except ValueError as error:
                raise ValueError(f"{name}, pair {record['pair']}: {error}") from None
            if name in costs:
                record[name]["seconds"] = costs[name].seconds
                self._costs[name].append(costs[name])
        rig = example.truth.rig
        from_depth = rig.depth_to_disparity(example.truth.depth)  # the images' disparity may have an offset
        self._true_depth_normals.add(fitted_normals(from_depth, rig.camera), pair)
        self.pairs.append(record)
        return example

    def predicted(self, index: int) -> tuple[Example, dict[str, Cost]]:
        """Return the predictions of every method for a pair, and the costs of those that were run; score nothing."""
        sample = self.dataset[index]
        left, right = sample.left, sample.right
        if self.degradation is not None:
            left, right = self.degradation.apply(left, right, np.random.default_rng((self.seed, index)))
        pair = pair_name(self.dataset, index)
        predictions: dict[str, Prediction] = {}
        costs: dict[str, Cost] = {}
        for name, method in self.methods.items():
            if isinstance(method, RecordedPredictions):
                shift = sample.meta.get(SHIFT_KEY, 0.0)
                predictions[name] = method.read(pair, index, sample.rig, shift)
                continue
            method = for_pair(method, sample)
            infer = partial(_infer_aligned if self.align_rows else inferred, method)
            with errors_at(f"{name}, pair {pair}"):
                if name not in self._warm:
                    infer(left, right, sample.rig)
                    self._warm.add(name)
                predictions[name], costs[name] = measured(infer, left, right, sample.rig)
        return Example(index, left, right, sample, predictions, pair, self.max_disparity), costs

    def result(self) -> Evaluation:
        """Return the figures so far, without examples."""
        changed = self.degradation is not None or self.align_rows
        results = {
            name: {
                **score.result(),
                "median_image": _medians([record[name] for record in self.pairs]),
                **_cost_figures(self._costs[name]),
                "gets_truth": gets_truth(self.methods[name]),
                "normals_are_fitted": not score.fit,
                "as_recorded": changed and isinstance(self.methods[name], RecordedPredictions),
            }
            for name, score in self._scores.items()
        }
        return Evaluation(results, self.pairs, self._true_depth_normals.result())

    def state_dict(self) -> dict[str, Any]:
        """Return the state, for SavedState.save."""
        return {
            "pairs": self.pairs,
            "scores": {name: score.state_dict() for name, score in self._scores.items()},
            "true_depth_normals": self._true_depth_normals.state_dict(),
            "costs": {name: [astuple(cost) for cost in costs] for name, costs in self._costs.items()},
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from a state_dict.

        Raises:
            KeyError: Something is missing in it.
        """
        self.pairs = state["pairs"]
        for name, score in self._scores.items():
            score.load_state_dict(state["scores"][name])
        self._true_depth_normals.load_state_dict(state["true_depth_normals"])
        self._costs = {name: [Cost(*cost) for cost in state["costs"][name]] for name in self.methods}


def evaluate(
    dataset: StereoPairs,
    estimators: Mapping[str, Method],
    *,
    limit: int | None = None,
    degradation: Degradation | None = None,
    seed: int = 0,
    max_disparity: float = MAX_DISPARITY,
    align_rows: bool = False,
    examples: int = 0,
    worst: int = 0,
    progress: Callable[[Sequence[int]], Iterable[int]] | None = None,
    saved_state: SavedState | None = None,
) -> Evaluation:
    """Score every method on the same pairs.

    Each estimator receives the first pair twice: the first time warms it up and is not timed. Besides the examples,
    memory grows by a few numbers a pair.

    Args:
        dataset: Samples with ground truth.
        estimators: The methods, by the name of their column.
        limit: Number of pairs to score, spread evenly over the dataset; None for all.
        degradation: Applied to the images first; its noise depends on (seed, index) alone. Recorded maps stay.
        seed: Seed of that noise.
        max_disparity: Pixels of a larger true disparity [px] are scored separately.
        align_rows: Align the rows of a pair where they lie significantly apart, before an estimator sees it. Recorded
            maps stay.
        examples: Number of pairs to keep for the figures, evenly spread.
        worst: Number of pairs to keep of those in which the first method's error is largest.
        progress: Wraps the indices of the pairs, as marssim.base.command.progress.watched does.
        saved_state: Where the state is saved, every 30 s and at the end, and loaded from; the caller removes it.

    Raises:
        ValueError: There is nothing to score, or a name or number cannot be used.
        EstimatorError: A method returned no Prediction of the images' size.
        FileNotFoundError: A recorded prediction is missing.
        SavedStateError: The saved state cannot be used.
        KeyboardInterrupt: With `saved_state`, after a signal (stop_on_signal), once the pair is scored and saved.
    """
    chosen, estimators = _checked(dataset, estimators, limit, seed)
    scoring = Scoring(dataset, estimators, degradation, seed, max_disparity, align_rows)
    if saved_state is not None and (state := saved_state.load()) is not None:
        try:
            scoring.load_state_dict(state)
        except (KeyError, TypeError, AttributeError, ValueError):
            raise saved_state.damaged() from None
    first = next(iter(estimators))
    shown = [chosen[i] for i in spread(len(chosen), examples)] if examples else []
    ranked = _worst(scoring.pairs, first, worst)
    kept: dict[int, Example] = {}
    stopping: AbstractContextManager[list[int]] = nullcontext([]) if saved_state is None else stop_on_signal()
    with stopping as signals:
        rest = chosen[len(scoring.pairs) :]
        for index in progress(rest) if progress else rest:
            example = scoring.add(index)
            ranked = _worst([*ranked, scoring.pairs[-1]], first, worst)
            wanted = {*shown, *(record["index"] for record in ranked)}
            kept = {i: one for i, one in {**kept, index: example}.items() if i in wanted}
            if saved_state is not None:
                saved_state.save_now_and_then(scoring.state_dict)
            if signals:
                break
        if saved_state is not None:
            saved_state.save(scoring.state_dict())
        if signals:
            raise KeyboardInterrupt
    out = scoring.result()
    out.examples, out.worst = (
        # Pairs that were scored before a stop are predicted again.
        [kept[i] if i in kept else scoring.predicted(i)[0] for i in indices]
        for indices in (shown, [record["index"] for record in ranked])
    )
    return out


def _infer_aligned(method: Estimator, left: np.ndarray, right: np.ndarray, rig: StereoRig) -> Prediction:
    """Predict for the pair with aligned rows, with the disparities that the given images show, by which it is scored.

    Args:
        method: The estimator.
        left: (H, W) or (H, W, 3) uint8 left image.
        right: The right image, likewise.
        rig: The cameras of these images.
    """
    straight, fit = align_rows(left, right, rig)
    prediction = inferred(method, left, straight, rig)
    if fit is None:
        return prediction
    columns = np.broadcast_to(np.arange(rig.camera.width, dtype=float), left.shape[:2])
    shown = columns - columns_in_given_image(columns - prediction.disparity, rig, fit)
    disparity = np.where(np.isfinite(prediction.depth), shown, prediction.disparity).astype(np.float32)
    return replace(prediction, disparity=disparity)


def _worst(records: Sequence[dict[str, Any]], method: str, number: int) -> list[dict[str, Any]]:
    """Return the records of the pairs in which the method's mean disparity error is largest, the largest first."""
    return sorted(records, key=lambda record: -record[method].get("epe", 0.0))[:number]


def check_choice(limit: int | None, seed: int) -> None:
    """Raise ValueError, which names the setting, unless the number of pairs and the seed can be used.

    Args:
        limit: Number of pairs; None for all.
        seed: Seed of the degradation's noise.
    """
    if limit is not None and limit < 1:
        raise ValueError(f"limit must be at least 1, got {limit}")
    if seed < 0:
        raise ValueError(f"seed must not be negative, got {seed}")


def _checked(
    dataset: StereoPairs, estimators: Mapping[str, Method], limit: int | None, seed: int
) -> tuple[list[int], dict[str, Method]]:
    """Return the indices of the pairs to score, and the methods, which have their files. Raises as `evaluate` does."""
    if not len(dataset):
        raise ValueError("the dataset holds no pairs")
    if not estimators:
        raise ValueError("no estimator to score")
    for name in RESERVED:
        if name in estimators:
            raise ValueError(f"no method may be called {name!r}: the records of the pairs use that name")
    check_choice(limit, seed)
    chosen = chosen_pairs(dataset, limit)
    names = [pair_name(dataset, index) for index in range(len(dataset))]
    methods = {
        name: method.of_pairs(chosen, names) if isinstance(method, RecordedPredictions) else method
        for name, method in estimators.items()
    }
    return [index for _, index in chosen], methods


def chosen_pairs(dataset: StereoPairs, limit: int | None) -> list[tuple[str, int]]:
    """Return names and indices of the pairs to score: `limit` of them, spread evenly over the dataset, or all."""
    chosen = spread(len(dataset), len(dataset) if limit is None else limit)
    return [(pair_name(dataset, index), index) for index in chosen]


def _medians(records: list[dict[str, Any]]) -> dict[str, float]:
    names = sorted({name for record in records for name in record} - NOT_FIGURES)
    return {name: float(np.median([r[name] for r in records if name in r])) for name in names}


def _cost_figures(costs: list[Cost]) -> dict[str, Any]:
    if not costs:
        return {"seconds": None, "memory_mib": None}
    seconds = [cost.seconds for cost in costs]
    peak, gpu = ([x for x in values if x is not None] for values in zip(*((c.peak_mib, c.gpu_mib) for c in costs)))
    return {
        "seconds": {"median": float(np.median(seconds)), "mean": float(np.mean(seconds))},
        "memory_mib": {"process": max(peak, default=None), "gpu": max(gpu, default=None)},
    }
