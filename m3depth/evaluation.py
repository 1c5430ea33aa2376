"""Methods scored on the same pairs, in one pass over them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from m3depth.degradation import Degradation
from m3depth.estimator import Estimator, EstimatorError, checked_prediction
from m3depth.figures.example import Example
from m3depth.pairs import MAX_DISPARITY, StereoPairs, spread
from m3depth.plane_normals import fitted_normals
from m3depth.prediction import Prediction
from m3depth.recorded import RecordedPredictions
from m3depth.resources import Cost, measured
from m3depth.scores import NormalScores, ScoredPair, Scores

RESERVED = ("index", "pair")  # fields of a pair's record, beside those of the methods

Method = Estimator | RecordedPredictions


@dataclass
class Evaluation:
    """What `evaluate` found out.

    results: by method, Scores.result() with "median_image" (the median over images of the image's figures), "seconds"
    (median and mean per pair) and "memory_mib" (the most that was held: by the process, everything in it included, and
    on a GPU); None for predictions that were read. pairs: a record per pair with the figures of each method.
    true_depth_normals: the normals that fitting planes to the true depth gives, by kind. examples: to be shown. worst:
    the pairs in which the first method's mean disparity error is largest, the largest first.
    """

    results: dict[str, dict[str, Any]]
    pairs: list[dict[str, Any]] = field(default_factory=list)
    true_depth_normals: dict[str, Any] = field(default_factory=dict)
    examples: list[Example] = field(default_factory=list)
    worst: list[Example] = field(default_factory=list)


def evaluate(
    dataset: StereoPairs,
    estimators: Mapping[str, Method],
    *,
    limit: int | None = None,
    degradation: Degradation | None = None,
    seed: int = 0,
    max_disparity: float = MAX_DISPARITY,
    examples: int = 0,
    worst: int = 0,
    progress: Callable[[Sequence[int]], Any] | None = None,
) -> Evaluation:
    """Score every method on the same pairs.

    dataset: samples with ground truth. estimators: by the name they are reported under. limit: score only so many
    pairs, spread evenly over the dataset. degradation: applied to the images first; its noise depends on (seed, index)
    alone. max_disparity [px]: nearer pixels are scored apart. examples: so many pairs are kept to be shown, evenly
    spread; worst: and so many of those that the first method got most wrong. progress: wraps the indices that are
    walked through, as marssim.progress.watched does. Besides what is kept to be shown, memory grows by a few numbers a
    pair.
    Each estimator sees the first pair twice: the first time warms it up and is not timed.
    Raises ValueError if there is nothing to score, EstimatorError if a method returns no Prediction of this size;
    FileNotFoundError if a recorded prediction is missing.
    """
    chosen = _checked(dataset, estimators, limit, seed)
    shown = {chosen[i] for i in spread(len(chosen), examples)} if examples else set()
    scores = {name: Scores(fit=not getattr(method, "normals_are_fitted", False)) for name, method in estimators.items()}
    true_depth_normals = NormalScores()
    costs: dict[str, list[Cost]] = {name: [] for name in estimators}
    warm: set[str] = set()
    out, first = Evaluation({}), next(iter(estimators))
    most_wrong: list[tuple[float, Example]] = []
    for index in progress(chosen) if progress else chosen:
        sample = dataset[index]
        pair = ScoredPair(sample, max_disparity)
        left, right = sample.left, sample.right
        if degradation is not None:
            rng = np.random.default_rng((seed, index))
            left, right = degradation.apply(left, right, rng)
        record: dict[str, Any] = {"index": index, "pair": _name(dataset, index)}
        predictions: dict[str, Prediction] = {}
        for name, method in estimators.items():
            if isinstance(method, RecordedPredictions):
                prediction = method.read(record["pair"], index, sample.rig)
                cost = None
            else:
                if name not in warm:
                    method.infer(left, right, sample.rig)
                    warm.add(name)
                found, cost = measured(method.infer, left, right, sample.rig)
                try:
                    prediction = checked_prediction(method, found, left.shape[:2])
                except EstimatorError as error:
                    raise EstimatorError(f"{name}, pair {index}: {error}") from None
                costs[name].append(cost)
            try:
                record[name] = scores[name].add(prediction, pair)
            except ValueError as error:
                raise ValueError(f"{name}, pair {index}: {error}") from None
            if cost is not None:
                record[name]["seconds"] = cost.seconds
            predictions[name] = prediction
        true_depth_normals.add(fitted_normals(sample.disparity, sample.rig.camera), pair)
        out.pairs.append(record)
        example = Example(index, left, right, sample, predictions)
        if index in shown:
            out.examples.append(example)
        wrong_by = record[first].get("epe", 0.0)
        most_wrong = sorted([*most_wrong, (wrong_by, example)], key=lambda kept: -kept[0])[:worst]
    out.worst = [example for _, example in most_wrong]
    out.true_depth_normals = true_depth_normals.result()
    for name, score in scores.items():
        figures = [record[name] for record in out.pairs]
        out.results[name] = {**score.result(), "median_image": _medians(figures), **_spent(costs[name])}
    return out


def check_choice(limit: int | None, seed: int) -> None:
    """Raise ValueError that names what cannot be used."""
    if limit is not None and limit < 1:
        raise ValueError(f"limit must be at least 1, got {limit}")
    if seed < 0:
        raise ValueError(f"seed must not be negative, got {seed}")


def _checked(dataset: StereoPairs, estimators: Mapping[str, Method], limit: int | None, seed: int) -> list[int]:
    """The indices to be scored, once everything that was asked for can be done."""
    if not len(dataset):
        raise ValueError("the dataset holds no pairs")
    if not estimators:
        raise ValueError("no estimator to score")
    for name in RESERVED:
        if name in estimators:
            raise ValueError(f"no method may be called {name!r}: the records of the pairs use that name themselves")
    check_choice(limit, seed)
    chosen = spread(len(dataset), len(dataset) if limit is None else limit)
    for method in estimators.values():
        if isinstance(method, RecordedPredictions):
            method.check([(_name(dataset, index), index) for index in chosen])
    return chosen


def _name(dataset: StereoPairs, index: int) -> str:
    """The dataset's own name of a pair, where it has one."""
    names = getattr(dataset, "names", None)
    return f"{index:06d}" if names is None else names[index]


def _medians(records: list[dict[str, float]]) -> dict[str, float]:
    names = sorted({name for record in records for name in record} - {"seconds"})
    return {name: float(np.median([r[name] for r in records if name in r])) for name in names}


def _spent(costs: list[Cost]) -> dict[str, Any]:
    if not costs:
        return {"seconds": None, "memory_mib": None}
    seconds = [cost.seconds for cost in costs]
    peak, gpu = ([x for x in found if x is not None] for found in zip(*((c.peak_mib, c.gpu_mib) for c in costs)))
    return {
        "seconds": {"median": float(np.median(seconds)), "mean": float(np.mean(seconds))},
        "memory_mib": {"process": max(peak, default=None), "gpu": max(gpu, default=None)},
    }
