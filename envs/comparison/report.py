"""The comparison of methods on a suite: a table by condition, with paired intervals, and a plot."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from envs.comparison.suite_results import Scores
from envs.drives.metrics import paired_scores, wilson_interval
from m3depth.evaluation.bootstrap import interval, resampled_means
from m3depth.figures.drawing import save

OVERALL = "all"  # row over all conditions


def compare_methods(methods: Mapping[str, Scores]) -> list[dict[str, Any]]:
    """Return a row for each condition and method, those over all conditions last.

    Only episodes that all methods have driven count, so that all rows of a condition hold for the same courses.

    Args:
        methods: Scores by the method's label. The first is what the others are compared to.

    Returns:
        condition, method, episodes, success_rate with its Wilson interval, spl with its bootstrap interval, and `less`:
        the difference to the first method as envs.drives.metrics.paired_difference has it; None for the first. Over all
        conditions the intervals are drawn by course, so Wilson's is left out.

    Raises:
        ValueError: The methods have no episode in common.
    """
    common = set.intersection(*(set(scores) for scores in methods.values()))
    shared = {condition for condition, _ in common}
    if not common:
        raise ValueError("the methods have no episode in common, so nothing can be compared")
    first = next(iter(methods))
    conditions = dict.fromkeys(condition for condition, _ in next(iter(methods.values())) if condition in shared)
    rows = []
    for condition in (*conditions, OVERALL):
        keys = sorted(key for key in common if condition in (OVERALL, key[0]))
        for method, scores in methods.items():
            driven = {key: scores[key] for key in keys}
            values = np.array(list(driven.values()))
            success = float(values[:, 0].mean())
            means = resampled_means(values[:, 1], [course for _, course in keys])
            rows.append(
                {
                    "condition": condition, "method": method, "episodes": len(keys), "success_rate": success,
                    "success_interval":
                        None if condition == OVERALL else list(wilson_interval(success * len(keys), len(keys))),
                    "spl": float(values[:, 1].mean()), "spl_interval": list(interval(means)),
                    "less": None if method == first else
                        paired_scores(driven, {key: methods[first][key] for key in keys}),
                }
            )  # fmt: skip
    return rows


def comparison_table(rows: list[dict[str, Any]]) -> str:
    """Return the rows as a Markdown table."""
    first = rows[0]["method"]
    lines = [
        "| condition | method | courses | success (95 %) | SPL (95 %) | success less first | SPL less first |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        wilson = "" if row["success_interval"] is None else _bounds(row["success_interval"], 100, ".0f")
        less = row["less"]
        differences = ("-", "-") if less is None else (
            f"{100 * less['difference']:+.0f} points{_bounds(less['interval'], 100, '+.0f')}",
            f"{less['spl_difference']:+.3f}{_bounds(less['spl_interval'], 1, '+.3f')}",
        )  # fmt: skip
        lines.append(
            f"| {row['condition']} | {row['method']} | {row['episodes']} | {100 * row['success_rate']:.0f} %{wilson} "
            f"| {row['spl']:.3f}{_bounds(row['spl_interval'], 1, '.3f')} | {differences[0]} | {differences[1]} |"
        )
    note = (
        f"The differences are those to {first} on the same courses, with 95 % intervals by the paired bootstrap over "
        "the courses. A difference without an interval is the same on all courses."
    )
    return "\n".join([*lines, "", note]) + "\n"


def plot_comparison(path: Path, rows: list[dict[str, Any]]) -> None:
    """Plot success and SPL by condition, with their intervals, one colour a method."""
    conditions = list(dict.fromkeys(row["condition"] for row in rows))
    methods = list(dict.fromkeys(row["method"] for row in rows))
    figure = Figure(figsize=(max(6.0, 0.7 * len(conditions) + 2), 6.0), dpi=110, layout="constrained")
    success, weighted = figure.subplots(2, 1, sharex=True)
    for n, method in enumerate(methods):
        own = [row for row in rows if row["method"] == method]
        at = np.arange(len(own)) + 0.6 * (n - (len(methods) - 1) / 2) / max(len(methods), 2)
        for axes, value, bounds, scale in (
            (success, "success_rate", "success_interval", 100), (weighted, "spl", "spl_interval", 1),
        ):  # fmt: skip
            middle = np.array([scale * row[value] for row in own])
            ends = np.array([[scale * end for end in row[bounds] or (row[value],) * 2] for row in own]).T
            error = np.abs(np.vstack([middle - ends[0], ends[1] - middle]))
            axes.errorbar(at, middle, error, fmt="o", color=f"C{n}", ms=4, lw=1.3, capsize=2, label=method)
    success.set(ylabel="success [%]", ylim=(-4, 104))
    weighted.set(ylabel="SPL", ylim=(-0.04, 1.04))
    weighted.set_xticks(range(len(conditions)), conditions, rotation=45, ha="right")
    for axes in (success, weighted):
        axes.grid(alpha=0.3)
    handles, labels = success.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=2, fontsize=8)
    save(figure, path)


def _bounds(bounds: list[float], scale: float, digits: str) -> str:
    low, high = bounds
    return f" ({scale * low:{digits}} to {scale * high:{digits}})" if low < high else ""
