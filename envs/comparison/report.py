"""The comparison of methods on a suite, condition by condition, with paired intervals."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from envs.comparison.suite_results import DrivenMethod, Episode, shared_episodes
from envs.drives.metrics import paired_scores, wilson_interval
from m3depth.evaluation.bootstrap import interval, resampled_means

OVERALL = "all"  # row over all conditions


def compare_methods(methods: Mapping[str, DrivenMethod]) -> list[dict[str, Any]]:
    """Return a row for each condition and method, those over all conditions last.

    Only episodes that all methods have driven count, so that all rows of a condition hold for the same courses.

    Args:
        methods: By label. The first is what the others are compared to.

    Returns:
        condition, method, episodes; success_rate with its interval, Wilson's for a condition, and by the bootstrap over
        the courses over all conditions; spl with its bootstrap interval; and `less`: the difference to the first method
        as envs.drives.metrics.paired_difference has it, None for the first. Courses of one number under several
        conditions are drawn together.

    Raises:
        ValueError: The methods have no episode in common.
    """
    shared = shared_episodes(methods)
    first = next(iter(methods))
    rows = []
    for condition in (*dict.fromkeys(condition for condition, _ in shared), OVERALL):
        keys = [key for key in shared if condition in (OVERALL, key[0])]
        drives = {label: {key: scores(method.episodes[key]) for key in keys} for label, method in methods.items()}
        for label, driven in drives.items():
            values = np.array(list(driven.values()))
            success, weighted = (float(mean) for mean in values.mean(axis=0))
            means = resampled_means(values, [course for _, course in keys])
            rows.append(
                {
                    "condition": condition, "method": label, "episodes": len(keys), "success_rate": success,
                    "success_interval": list(
                        interval(means[:, 0]) if condition == OVERALL
                        else wilson_interval(success * len(keys), len(keys))
                    ),
                    "spl": weighted, "spl_interval": list(interval(means[:, 1])),
                    "less": None if label == first else paired_scores(driven, drives[first]),
                }
            )  # fmt: skip
    return rows


def scores(episode: Episode) -> tuple[float, float]:
    """Return success and SPL of an episode."""
    return float(episode["success"]), float(episode["spl"])


def comparison_table(rows: list[dict[str, Any]]) -> str:
    """Return the rows of compare_methods as a Markdown table."""
    first = rows[0]["method"]
    lines = [
        "| condition | method | courses | success (95 %) | SPL (95 %) | success less first | SPL less first |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        less = row["less"]
        differences = ("-", "-") if less is None else (
            f"{100 * less['difference']:+.0f} points{bounds(less['interval'], 100, '+.0f')}",
            f"{less['spl_difference']:+.3f}{bounds(less['spl_interval'], 1, '+.3f')}",
        )  # fmt: skip
        lines.append(
            f"| {row['condition']} | {in_table(row['method'])} | {row['episodes']} "
            f"| {100 * row['success_rate']:.0f} %{bounds(row['success_interval'], 100, '.0f')} "
            f"| {row['spl']:.3f}{bounds(row['spl_interval'], 1, '.3f')} | {differences[0]} | {differences[1]} |"
        )
    note = (
        f"The differences are those to {in_table(first)} on the same courses, with 95 % intervals by the paired "
        "bootstrap over the courses. A difference without an interval is the same on all courses."
    )
    return "\n".join([*lines, "", note]) + "\n"


def in_table(name: str) -> str:
    """Return a name that a stranger chose as text in a cell of a Markdown table."""
    return name.replace("\\", "\\\\").replace("|", "\\|").replace("<", "\\<")


def bounds(ends: tuple[float, float] | list[float], scale: float, digits: str) -> str:
    """Return an interval in words, as " (0.71 to 0.84)"; "" if it has no width."""
    low, high = ends
    return f" ({scale * low:{digits}} to {scale * high:{digits}})" if low < high else ""
