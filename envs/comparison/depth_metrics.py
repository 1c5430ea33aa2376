"""Which metric of the depth goes with drives: success and SPL over the errors of the depth on the way."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from envs.comparison.jackknife import jackknife_interval
from envs.comparison.methods import DrivenMethod, shared_episodes
from envs.comparison.report import scores
from envs.comparison.suite_results import Episode
from envs.drives.report import bounds
from envs.world.perception import GROUND_TRUTH
from m3depth.evaluation.bootstrap import FEWEST_CLUSTERS
from marssim.base.files.markdown import in_table

FEWEST = 3  # dots that a correlation needs, and that must differ from the others in the metric and in the score
DIGITS = 12  # decimals of scores and metrics that count, as means of equal values may differ by rounding
CORRELATIONS = ("spearman", "within", "pearson")  # in a row of correlate
NO_INTERVAL = (
    "No correlation is given where it would have no interval (-). An interval takes "
    f"{FEWEST_CLUSTERS} courses and {FEWEST_CLUSTERS} conditions or more, and, whichever of them is left out, a "
    "correlation other than 1 and -1."
)
SCORES = {"success_rate": ("success [%]", 100), "spl": ("SPL", 1)}  # words of an axis, and its scale

Dot = Mapping[str, Any]


class Metric(NamedTuple):
    """A metric of the depth on the way."""

    words: str
    """What an axis and a table call it."""
    of_drives: Callable[[Sequence[Episode]], float | None]
    """Returns it for the drives of a method under one condition; None where it was not recorded."""
    logarithmic: bool = False
    """Whether its logarithm is plotted and correlated, as it spans decades."""


def _mean_abs_rel(drives: Sequence[Episode]) -> float | None:
    errors = _abs_rel(drives)
    return float(np.mean(errors)) if errors else None


def _median_abs_rel(drives: Sequence[Episode]) -> float | None:
    errors = _abs_rel(drives)
    return float(np.median(errors)) if errors else None


def _abs_rel(drives: Sequence[Episode]) -> list[float]:
    return [drive["abs_rel"] for drive in drives if drive.get("abs_rel") is not None]


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


def condition_dots(methods: Mapping[str, DrivenMethod], without: int | None = None) -> list[dict[str, Any]]:
    """Return a dot for each condition and method, over the episodes that all methods have driven.

    Args:
        methods: By label.
        without: Number of a course to leave out, under all conditions.

    Returns:
        condition, method, episodes, success_rate, spl; each metric of METRICS, and median_abs_rel, over the drives,
        None where it was not recorded, as with true depth; and success_rate_less_truth and spl_less_truth: what is left
        after taking away the scores of the same driver with true depth, None where no method drove with it.

    Raises:
        ValueError: The methods have no episode in common.
    """
    shared = [key for key in shared_episodes(methods) if key[1] != without]
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
                    "median_abs_rel": _median_abs_rel(drives[label]),
                    **{
                        f"{name}_less_truth": None if value is None else float(value)
                        for name, value in zip(SCORES, less, strict=True)
                    },
                }
            )  # fmt: skip
    return dots


def depth_table(dots: Sequence[Dot]) -> str:
    """Return the metrics of each dot as a Markdown table, without dots that have none; "" if none has any."""
    words = {name: metric.words for name, metric in METRICS.items()}
    columns = {"abs_rel": f"{words.pop('abs_rel')}, mean", "median_abs_rel": "median", **words}
    rows = [
        "| ".join(
            [f"| {dot['condition']} ", f"{in_table(dot['method'])} ", f"{dot['episodes']} "]
            + [f"{'-' if dot[name] is None else f'{dot[name]:.3g}'} " for name in columns]
        )
        + "|"
        for dot in dots
        if any(dot[name] is not None for name in columns)
    ]
    if not rows:
        return ""
    heads = ["condition", "method", "drives", *columns.values()]
    return "\n".join([f"| {' | '.join(heads)} |", "|---" * len(heads) + "|", *rows]) + "\n"


def dots_without_each_course(methods: Mapping[str, DrivenMethod]) -> list[list[dict[str, Any]]]:
    """Return the dots of condition_dots without each of the courses in turn, for the intervals of correlate."""
    return [condition_dots(methods, course) for course in sorted({course for _, course in shared_episodes(methods)})]


def correlate(dots: Sequence[Dot], without_course: Sequence[Sequence[Dot]] = ()) -> list[dict[str, Any]]:
    """Return the correlation of each score with each metric, over the dots that have both.

    Metrics of one_sided are left out. Spearman's correlation is that of the ranks. Pearson's is that with the logarithm
    of a metric that spans decades, if no dot has 0. Values that differ by rounding alone count as equal. Intervals are
    by the jackknife over the courses, which all conditions have in common, and over the conditions; both variances are
    added.

    Args:
        dots: Of condition_dots.
        without_course: Of dots_without_each_course.

    Returns:
        Rows with score ("success_rate" or "spl", alone and with "_less_truth"), metric, dots (how many), logarithmic
        (whether Pearson's is with the logarithm), and spearman, pearson, within (Spearman's within methods, see
        ranks_within) and weaker (how much smaller spearman is without its sign than that of the strongest metric for
        this score among those with an interval, over the dots that have both; None for the strongest itself), each with
        its 95 % interval, None with fewer than four courses or conditions, and where there is no correlation without
        one of them. There is no row of fewer than three dots, or where fewer than three (of three dots: two) differ
        from the value that most have, in the metric or in the score.
    """
    conditions = dict.fromkeys(dot["condition"] for dot in dots)
    without_condition = [[dot for dot in dots if dot["condition"] != left_out] for left_out in conditions]

    def measured(kind: str, statistic: Callable[[Sequence[Dot]], float], is_correlation: bool) -> dict[str, Any]:
        value = statistic(dots)
        replicates = [np.array([*map(statistic, left)]) for left in (without_course, without_condition)]
        ends = jackknife_interval(value, replicates, is_correlation)
        return {kind: value if np.isfinite(value) else None, f"{kind}_interval": ends}

    rows, excluded = [], one_sided(dots)
    for score in (*SCORES, *(f"{name}_less_truth" for name in SCORES)):
        of_score = []
        for name, metric in METRICS.items():
            both, (x, y) = _both(dots, name, score)
            if name in excluded or _too_few(x, y):
                continue
            logarithmic = bool(metric.logarithmic and x.min() > 0)
            row: dict[str, Any] = {"score": score, "metric": name, "dots": len(both), "logarithmic": logarithmic}
            row |= measured("spearman", partial(_spearman, name, score), True)
            row |= measured("within", partial(_within, name, score), True)
            row |= measured("pearson", partial(_pearson, name, score, logarithmic), True)
            of_score.append(row | {"weaker": None, "weaker_interval": None})
        certain = [row for row in of_score if row["spearman_interval"] is not None]
        strongest = max(certain or of_score, key=lambda row: abs(row["spearman"]), default=None)
        for row in of_score:
            if strongest is not None and row is not strongest:
                _, values = _both(dots, row["metric"], strongest["metric"], score)
                if not _too_few(*values):
                    row |= measured("weaker", partial(_weaker, row["metric"], strongest["metric"], score), False)
        rows += of_score
    return rows


def only_with_intervals(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return the rows of correlate with None for each value that has no interval.

    Few dots can have a correlation of 1 by chance, and without an interval nobody sees that.
    """
    kinds = (*CORRELATIONS, "weaker")
    return [{**row, **{kind: None for kind in kinds if row[f"{kind}_interval"] is None}} for row in rows]


def one_sided(dots: Sequence[Dot]) -> dict[str, str]:
    """Return the metrics that have one value throughout within each of several methods but one, and that method.

    The share of the ground that is taken for sky is such a metric, where one method alone recognises sky. A correlation
    with it says that this method differs from the others, in the metric and in the drives.

    Args:
        dots: Of condition_dots.
    """
    out = {}
    for name in METRICS:
        both, (values,) = _both(dots, name)
        methods = [dot["method"] for dot in both]
        several = [method for method in dict.fromkeys(methods) if methods.count(method) > 1]
        varying = [method for method in several if _differing(values[[other == method for other in methods]])]
        if len(several) > 1 and len(varying) == 1:
            out[name] = varying[0]
    return out


def _both(dots: Sequence[Dot], *names: str) -> tuple[list[Dot], list[np.ndarray]]:
    """Return the dots that have all of these entries, and each entry of them."""
    both = [dot for dot in dots if all(dot[name] is not None for name in names)]
    return both, [np.array([dot[name] for dot in both], float).round(DIGITS) for name in names]


def _spearman(metric: str, score: str, dots: Sequence[Dot]) -> float:
    _, (x, y) = _both(dots, metric, score)
    return correlation(_ranks(x), _ranks(y))


def _pearson(metric: str, score: str, logarithmic: bool, dots: Sequence[Dot]) -> float:
    _, (x, y) = _both(dots, metric, score)
    if logarithmic and (x <= 0).any():  # without one of the courses, a dot may have no errors
        return float("nan")
    return correlation(np.log(x) if logarithmic else x, y)


def _ranks(values: np.ndarray) -> np.ndarray:
    """Return the ranks of values (n,), from 1; equal values share the mean of theirs."""
    from scipy.stats import rankdata  # not at the top, since it takes a third of the command's start

    return rankdata(values)


def _within(metric: str, score: str, dots: Sequence[Dot]) -> float:
    both, (x, y) = _both(dots, metric, score)
    return correlation(*ranks_within(x, y, [dot["method"] for dot in both]))


def _weaker(metric: str, strongest: str, score: str, dots: Sequence[Dot]) -> float:
    """Return by how much the correlation of a metric is weaker than that of the strongest, over dots that have both."""
    _, (x, best, y) = _both(dots, metric, strongest, score)
    size, best_size = (abs(correlation(_ranks(values), _ranks(y))) for values in (x, best))
    return best_size - size


def _too_few(*values: np.ndarray) -> bool:
    """Return whether values (n,) of dots are too few for a correlation, or too few of one kind differ."""
    return len(values[0]) < FEWEST or min(map(_differing, values)) < min(FEWEST, len(values[0]) - 1)


def _differing(values: np.ndarray) -> int:
    """Return how many values differ from the one that most have."""
    return len(values) - int(np.unique(values, return_counts=True)[1].max())


def correlation_of(rows: Sequence[Mapping[str, Any]], score: str, metric: str) -> Mapping[str, Any] | None:
    """Return the row of correlate for a score and a metric; None if there is none."""
    return next((row for row in rows if (row["score"], row["metric"]) == (score, metric)), None)


def correlation_table(rows: Sequence[Mapping[str, Any]], left_out: Mapping[str, str] | None = None) -> str:
    """Return the rows of correlate as a Markdown table, with a note on what they are; without rows, say why.

    Args:
        rows: Of correlate, as only_with_intervals returns them.
        left_out: Of one_sided.
    """
    reasons = "".join(
        f"\nNo correlation with the {METRICS[name].words}: within all methods but {in_table(method)}, it is the same "
        "under all conditions, so it would only tell this method from the others.\n"
        for name, method in (left_out or {}).items()
    )
    if not rows:
        return (
            f"No correlation of scores with the depth: it takes {FEWEST} dots or more (a method under a condition) "
            f"that differ from the others in an error of the depth and in a score.\n{reasons}"
        )
    lines = [
        "| score | metric of the depth | dots | Spearman (95 %) | weaker than the strongest by (95 %) "
        "| Spearman within methods (95 %) | Pearson (95 %) |", "|---|---|---|---|---|---|---|",
        *(
            f"| {_score_in_words(row['score'])} | {METRICS[row['metric']].words} | {row['dots']} "
            + "".join(f"| {correlation_in_words(row, kind)} " for kind in ("spearman", "weaker", "within", "pearson"))
            + ("by the logarithm |" if row["logarithmic"] and row["pearson"] is not None else "|")
            for row in rows
        ),
    ]  # fmt: skip
    note = (
        "A dot is a method under a condition. Metric and score are of the same drives, so a drive that fails, and "
        "looks longer at what stops it, changes both. Intervals are by the jackknife over the courses and over the "
        "conditions. By the logarithm: the correlation with the logarithm of the metric. Less true depth: less the "
        "score of the same driver with true depth on the same courses, which leaves out how hard a condition is. "
        "Weaker: how much smaller the correlation is, without its sign, than that of the strongest metric, over "
        "the dots that have both; the strongest was chosen on the same drives. Within methods: of the ranks among the "
        "dots of each method, which leaves out that one method is worse than another throughout, in the depth and in "
        "the drives. "
        "The intervals hold for these methods: others were not drawn."
    )
    if any(row[kind] is None for row in rows for kind in CORRELATIONS):
        reasons = f"\n{NO_INTERVAL}\n{reasons}"
    return "\n".join([*lines, "", note]) + f"\n{reasons}"


def correlation_in_words(row: Mapping[str, Any], kind: str) -> str:
    """Return an entry of a row of correlate, such as "spearman", with its interval if it has one; "-" if it is None."""
    ends = row[f"{kind}_interval"]
    return "-" if row[kind] is None else f"{row[kind]:+.2f}{bounds(ends, 1, '+.2f') if ends else ''}"


def _score_in_words(score: str) -> str:
    name = score.removesuffix("_less_truth")
    words = {"success_rate": "success", "spl": "SPL"}[name]
    return words if score == name else f"{words} less true depth"


def ranks_within(x: np.ndarray, y: np.ndarray, groups: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """Return the ranks of both among those of their group, less their mean there.

    A difference between groups, such as one method that has the worse depth and the worse drives throughout, does not
    contribute to the correlation of such ranks. Groups in which one of the two has a single value are left out.

    Args:
        x: (n,).
        y: (n,).
        groups: (n,).

    Returns:
        (m,) ranks of x and of y.
    """
    centred: list[tuple[np.ndarray, np.ndarray]] = [(np.zeros(0), np.zeros(0))]
    for group in dict.fromkeys(groups):
        members = [i for i, other in enumerate(groups) if other == group]
        if _differing(x[members]) and _differing(y[members]):
            of_x, of_y = (_ranks(values[members]) for values in (x, y))
            centred.append((of_x - of_x.mean(), of_y - of_y.mean()))
    return np.concatenate([of_x for of_x, _ in centred]), np.concatenate([of_y for _, of_y in centred])


def correlation(x: np.ndarray, y: np.ndarray) -> float:
    """Return Pearson's correlation of two (n,); NaN without pairs, and where x or y has one value only."""
    if not len(x) or not _differing(x) or not _differing(y):
        return float("nan")
    return float(np.corrcoef(x, y)[0, 1])
