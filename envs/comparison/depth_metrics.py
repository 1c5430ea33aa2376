"""Which metric of the depth predicts drives: success and SPL over the errors of the depth on the way."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from envs.comparison.methods import DrivenMethod, shared_episodes
from envs.comparison.report import scores
from envs.comparison.suite_results import Episode
from envs.drives.report import bounds
from envs.world.perception import GROUND_TRUTH
from m3depth.evaluation.bootstrap import DRAWS, interval

FEWEST = 3  # dots that a correlation needs, and that must differ from the others in the metric and in the score
FEWEST_CONDITIONS = 4  # that its interval needs
MOST_WITHOUT = 0.05  # share of the samples of its bootstrap that may have no correlation
DIGITS = 12  # decimals of scores and metrics that count, as means of equal values may differ by rounding
SCORES = {"success_rate": ("success [%]", 100), "spl": ("SPL", 1)}  # words of an axis, and its scale


class Metric(NamedTuple):
    """A metric of the depth on the way."""

    words: str
    """What an axis and a table call it."""
    of_drives: Callable[[Sequence[Episode]], float | None]
    """Returns it for the drives of a method under one condition; None where it was not recorded."""
    logarithmic: bool = False
    """Whether its logarithm is plotted and correlated, as it spans decades."""


def _mean_abs_rel(drives: Sequence[Episode]) -> float | None:
    errors = [drive["abs_rel"] for drive in drives if drive.get("abs_rel") is not None]
    return float(np.mean(errors)) if errors else None


def _ratio(count: str, among: str) -> Callable[[Sequence[Episode]], float | None]:
    """Return a function that returns the sum of one count over the sum of another."""

    def ratio(drives: Sequence[Episode]) -> float | None:
        counted = [drive for drive in drives if drive.get(count) is not None and drive.get(among) is not None]
        total = sum(drive[among] for drive in counted)
        return sum(drive[count] for drive in counted) / total if total else None

    return ratio


METRICS = {
    "abs_rel": Metric("Abs Rel on the way", _mean_abs_rel, logarithmic=True),
    "rocks_missed": Metric("share of rocks missed on the way", _ratio("rocks_missed", "rocks")),
    "false_obstacles": Metric("false obstacles in a look", _ratio("false_obstacles", "looks")),
    "near_ground_as_sky": Metric(
        "share of the ground within 8 m taken for sky", _ratio("near_ground_as_sky", "near_ground")
    ),
}


def condition_dots(methods: Mapping[str, DrivenMethod]) -> list[dict[str, Any]]:
    """Return a dot for each condition and method, over the episodes that all methods have driven.

    Args:
        methods: By label.

    Returns:
        condition, method, episodes, success_rate, spl; each metric of METRICS, None where it was not recorded, as with
        true depth; and success_rate_less_truth and spl_less_truth: what is left after taking away the scores of the
        same driver with true depth, None where no method drove with it.

    Raises:
        ValueError: The methods have no episode in common.
    """
    shared = shared_episodes(methods)
    dots = []
    for condition in dict.fromkeys(condition for condition, _ in shared):
        drives = {
            label: [method.episodes[key] for key in shared if key[0] == condition] for label, method in methods.items()
        }
        means = {label: np.mean([scores(drive) for drive in driven], axis=0) for label, driven in drives.items()}
        for label, method in methods.items():
            truth = next(
                (
                    means[other] for other, its in methods.items()
                    if (its.driver, its.perception) == (method.driver, GROUND_TRUTH)
                ),
                None,
            )  # fmt: skip
            less = (None, None) if truth is None else means[label] - truth
            dots.append(
                {
                    "condition": condition, "method": label, "episodes": len(drives[label]),
                    **{name: float(mean) for name, mean in zip(SCORES, means[label], strict=True)},
                    **{name: metric.of_drives(drives[label]) for name, metric in METRICS.items()},
                    **{
                        f"{name}_less_truth": None if value is None else float(value)
                        for name, value in zip(SCORES, less, strict=True)
                    },
                }
            )  # fmt: skip
    return dots


def correlate(dots: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return the correlation of each score with each metric, over the dots that have both.

    Spearman's correlation is that of the ranks. Pearson's is that with the logarithm of a metric that spans decades, if
    no dot has 0. Values that differ by rounding alone count as equal. Intervals are by the bootstrap over the
    conditions: all dots of a condition are drawn together, as its courses make them alike.

    Args:
        dots: Of condition_dots.

    Returns:
        Rows with score ("success_rate" or "spl", alone and with "_less_truth"), metric, dots (how many), logarithmic
        (whether Pearson's is with the logarithm), and spearman, pearson, within (Spearman's within methods, see
        ranks_within) and weaker (how much smaller spearman is without its sign than that of the strongest metric for
        this score, over the dots that have both; None for the strongest itself), each with its 95 % interval, None with
        fewer than four conditions, and where more than one of 20 samples of the bootstrap has no correlation. There
        is no row of fewer than three dots, or where fewer than three (of three dots: two) differ from the value that
        most have, in the metric or in the score.
    """
    rows = []
    for score in (*SCORES, *(f"{name}_less_truth" for name in SCORES)):
        of_score = []
        for name, metric in METRICS.items():
            both, (x, y) = _both(dots, name, score)
            if _too_few(x, y):
                continue
            logarithmic = metric.logarithmic and x.min() > 0
            conditions, methods = ([dot[key] for dot in both] for key in ("condition", "method"))
            weights = _resampled(conditions)
            of_each = {
                "spearman": correlation(ranks(x, weights), ranks(y, weights), weights),
                "within": correlation(ranks_within(x, methods, weights), ranks_within(y, methods, weights), weights),
                "pearson": correlation(np.log(x) if logarithmic else x, y, weights),
            }
            row: dict[str, Any] = {"score": score, "metric": name, "dots": len(both), "logarithmic": bool(logarithmic)}
            for kind, values in of_each.items():
                row |= _with_interval(kind, values, conditions)
            of_score.append(row | {"weaker": None, "weaker_interval": None})
        strongest = max(of_score, key=lambda row: abs(row["spearman"]), default=None)
        for row in of_score:
            if strongest is not None and row is not strongest:
                row |= _weaker(dots, score, row["metric"], strongest["metric"])
        rows += of_score
    return rows


def _both(dots: Sequence[Mapping[str, Any]], *names: str) -> tuple[list[Mapping[str, Any]], list[np.ndarray]]:
    """Return the dots that have all of these entries, and each entry of them."""
    both = [dot for dot in dots if all(dot[name] is not None for name in names)]
    return both, [np.array([dot[name] for dot in both], float).round(DIGITS) for name in names]


def _with_interval(name: str, values: np.ndarray, conditions: Sequence[str]) -> dict[str, Any]:
    """Return a statistic, the first of its values in the samples of _resampled, and its interval; None if unknown."""
    known = np.isfinite(values)
    enough = len(set(conditions)) >= FEWEST_CONDITIONS and known.mean() >= 1 - MOST_WITHOUT
    return {
        name: float(values[0]) if known[0] else None,
        f"{name}_interval": list(interval(values[known])) if enough and known[0] else None,
    }


def _weaker(dots: Sequence[Mapping[str, Any]], score: str, metric: str, strongest: str) -> dict[str, Any]:
    """Return "weaker" of correlate and its interval."""
    both, (x, best, y) = _both(dots, metric, strongest, score)
    if _too_few(x, best, y):
        return {}
    conditions = [dot["condition"] for dot in both]
    weights = _resampled(conditions)
    of_score = ranks(y, weights)
    size, best_size = (np.abs(correlation(ranks(v, weights), of_score, weights)) for v in (x, best))
    return _with_interval("weaker", best_size - size, conditions)


def _too_few(*values: np.ndarray) -> bool:
    """Return whether values (n,) of dots are too few for a correlation, or too few of one kind differ."""
    return len(values[0]) < FEWEST or min(map(_differing, values)) < min(FEWEST, len(values[0]) - 1)


def _differing(values: np.ndarray) -> int:
    """Return how many values differ from the one that most have."""
    return len(values) - int(np.unique(values, return_counts=True)[1].max())


def correlation_of(rows: Sequence[Mapping[str, Any]], score: str, metric: str) -> Mapping[str, Any] | None:
    """Return the row of correlate for a score and a metric; None if there is none."""
    return next((row for row in rows if (row["score"], row["metric"]) == (score, metric)), None)


def correlation_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the rows of correlate as a Markdown table, with a note on what they are; without rows, say why."""
    if not rows:
        return (
            f"No correlation of scores with the depth: it takes {FEWEST} dots or more (a method under a condition) "
            "that differ from the others in an error of the depth and in a score.\n"
        )
    lines = [
        "| score | metric of the depth | dots | Spearman (95 %) | weaker than the strongest by (95 %) "
        "| Spearman within methods (95 %) | Pearson (95 %) |", "|---|---|---|---|---|---|---|",
        *(
            f"| {_score_in_words(row['score'])} | {METRICS[row['metric']].words} | {row['dots']} "
            + "".join(f"| {correlation_in_words(row, kind)} " for kind in ("spearman", "weaker", "within", "pearson"))
            + ("by the logarithm |" if row["logarithmic"] else "|")
            for row in rows
        ),
    ]  # fmt: skip
    note = (
        "A dot is a method under a condition. Intervals are by the bootstrap over the conditions, where there are "
        f"{FEWEST_CONDITIONS} or more and nearly all samples have a correlation. By the logarithm: the correlation "
        "with the logarithm of the metric. Less true depth: less the score of the same driver with true depth on the "
        "same courses, which leaves out how hard a condition is for any eyes. Weaker: how much smaller the correlation "
        "is, without its sign, than that of the strongest metric, over the dots that have both; the strongest was "
        "chosen on the same drives. Within methods: of the ranks among the dots of each method, which leaves out "
        "that one method is worse than another throughout, in the depth and in the drives. "
        "The intervals hold for these methods: others were not drawn."
    )
    return "\n".join([*lines, "", note]) + "\n"


def correlation_in_words(row: Mapping[str, Any], kind: str) -> str:
    """Return an entry of a row of correlate, such as "spearman", with its interval if it has one; "-" if it is None."""
    ends = row[f"{kind}_interval"]
    return "-" if row[kind] is None else f"{row[kind]:+.2f}{bounds(ends, 1, '+.2f') if ends else ''}"


def _score_in_words(score: str) -> str:
    name = score.removesuffix("_less_truth")
    words = {"success_rate": "success", "spl": "SPL"}[name]
    return words if score == name else f"{words} less true depth"


def _resampled(clusters: Sequence[str]) -> np.ndarray:
    """Return how often each dot is in a sample, (1 + DRAWS, n): all once, and then samples of whole clusters."""
    number = {name: i for i, name in enumerate(dict.fromkeys(clusters))}
    picks = np.random.default_rng(0).integers(0, len(number), (DRAWS, len(number)))
    drawn = np.apply_along_axis(np.bincount, 1, picks, minlength=len(number))
    weights = drawn[:, [number[name] for name in clusters]]
    return np.vstack([np.ones(len(clusters)), weights])


def ranks(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the ranks of values in samples that hold each of them several times; equal values have their mean rank.

    Args:
        values: (n,).
        weights: (samples, n) how often each value is in a sample.

    Returns:
        (samples, n) ranks, from 0.5.
    """
    below = (values[None] < values[:, None]) + 0.5 * (values[None] == values[:, None])
    return weights @ below.T


def ranks_within(values: np.ndarray, groups: Sequence[str], weights: np.ndarray) -> np.ndarray:
    """Return the ranks of values among those of their group, less their mean there; else as `ranks`.

    A difference between groups, such as one method that has the worse depth and the worse drives throughout, does not
    contribute to the correlation of such ranks.

    Args:
        values: (n,).
        groups: (n,).
        weights: (samples, n).
    """
    centred = np.zeros(weights.shape)
    for group in set(groups):
        members = [i for i, other in enumerate(groups) if other == group]
        of_group = weights[:, members]
        ranked, total = ranks(values[members], of_group), of_group.sum(axis=1, keepdims=True)
        centred[:, members] = ranked - (of_group * ranked).sum(axis=1, keepdims=True) / np.maximum(total, 1)
    return centred


def correlation(x: np.ndarray, y: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return Pearson's correlation in samples that hold each pair several times.

    Args:
        x: (n,) or (samples, n).
        y: Likewise.
        weights: (samples, n) how often each pair is in a sample.

    Returns:
        (samples,); NaN where x or y has one value only.
    """
    total = weights.sum(axis=1, keepdims=True)
    dx, dy = (v - (weights * v).sum(axis=1, keepdims=True) / total for v in (x, y))
    covariance, of_x, of_y = ((weights * product).sum(axis=1) for product in (dx * dy, dx * dx, dy * dy))
    spread = np.sqrt(of_x * of_y)
    constant = (of_x <= 1e-12 * np.square(x).max()) | (of_y <= 1e-12 * np.square(y).max())
    return np.where(constant, np.nan, covariance / np.where(constant, 1, spread))
