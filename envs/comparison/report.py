"""The comparison of methods on a suite, condition by condition, with paired intervals."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from envs.comparison.methods import DrivenMethod, shared_episodes
from envs.comparison.suite_results import Episode, Key
from envs.drives.metrics import count_failures, effective_drives, paired_scores, spl_interval, wilson_interval
from envs.drives.report import bounds
from envs.suites.suite import OVERALL
from envs.world.perception import GROUND_TRUTH
from m3depth.estimator import M3DEPTH
from m3depth.evaluation.bootstrap import FEWEST_CLUSTERS
from marssim.base.command.wording import counted
from marssim.base.files.markdown import in_table

DEPTH_ERRORS = ("abs_rel", "rocks", "false_obstacles", "looks", "near_ground")  # what depth_metrics reads
SHOWN = 12  # digits of a digest that a note shows


def compare_methods(methods: Mapping[str, DrivenMethod]) -> list[dict[str, Any]]:
    """Return a row for each condition and method, those over all conditions last, if there are several.

    Only episodes that all methods have driven count, so that all rows of a condition hold for the same courses.

    Args:
        methods: By label. The first is what the others are compared to.

    Returns:
        condition, method, episodes; courses: how many numbers they have; success_rate with Wilson's interval, over
        several conditions that of as many drives as effective_drives says; spl with its interval by the bootstrap over
        the courses, None with fewer than FEWEST_CLUSTERS of them; and `less`: the difference to the first method as
        envs.drives.metrics.paired_difference has it, None for the first. Courses of one number under several conditions
        are drawn together.

    Raises:
        ValueError: The methods have no episode in common.
    """
    shared = shared_episodes(methods)
    first = next(iter(methods))
    conditions = list(dict.fromkeys(condition for condition, _ in shared))
    rows = []
    for condition in (*conditions, OVERALL) if len(conditions) > 1 else conditions:
        keys = sorted(key for key in shared if condition in (OVERALL, key[0]))  # the bootstrap draws courses by place
        drives = {label: {key: scores(method.episodes[key]) for key in keys} for label, method in methods.items()}
        for label, driven in drives.items():
            values = np.array(list(driven.values()))
            success, weighted = (float(mean) for mean in values.mean(axis=0))
            courses = [course for _, course in keys]
            number = effective_drives(values[:, 0], courses)
            rows.append(
                {
                    "condition": condition, "method": label, "episodes": len(keys),
                    "courses": len(set(courses)), "success_rate": success,
                    "success_interval": list(wilson_interval(success * number, number)),
                    "spl": weighted, "spl_interval": spl_interval(values[:, 1], courses),
                    "less": None if label == first else paired_scores(driven, drives[first]),
                }
            )  # fmt: skip
    return rows


def comparison_table(rows: list[dict[str, Any]]) -> str:
    """Return the rows of compare_methods as a Markdown table."""
    first = rows[0]["method"]
    lines = [
        "| condition | method | drives | success (95 %) | SPL (95 %) | success, difference to first "
        "| SPL, difference to first |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        less = row["less"]
        differences = ("-", "-") if less is None else (
            f"{100 * less['difference']:+.0f} points{bounds(less['interval'], 100, '+.0f')}",
            f"{less['spl_difference']:+.2f}{bounds(less['spl_interval'], 1, '+.2f')}",
        )  # fmt: skip
        episodes, courses = row["episodes"], row["courses"]
        drives = str(episodes) if episodes == courses else f"{episodes} on {courses} courses"
        lines.append(
            f"| {row['condition']} | {in_table(row['method'])} | {drives} "
            f"| {100 * row['success_rate']:.0f} %{bounds(row['success_interval'], 100, '.0f')} "
            f"| {row['spl']:.2f}{bounds(row['spl_interval'], 1, '.2f')} | {differences[0]} | {differences[1]} |"
        )
    note = (
        f"The differences are those to {in_table(first)} on the same courses. Intervals are 95 %: that of success is "
        f"Wilson's, and that of its difference Newcombe's for paired proportions; in the row {OVERALL}, they count "
        "drives on courses of one number as fewer, as these resemble each other. Those of SPL are by the bootstrap "
        f"over the courses, paired for differences, and are given for {FEWEST_CLUSTERS} courses or more. Otherwise, an "
        "SPL without an interval is the same on all courses."
    )
    return "\n".join([*lines, "", note]) + "\n"


def comparison_notes(methods: Mapping[str, DrivenMethod]) -> list[str]:
    """Return sentences on what the rows of compare_methods rest on.

    They say how many episodes are compared, and how many are left out as a method lacks them; whether the row over all
    conditions weighs them unequally; what drove each method; and whether different code drove them, or episodes lack an
    error of the depth.

    Args:
        methods: By label.

    Raises:
        ValueError: The methods have no episode in common.
    """
    shared = shared_episodes(methods)
    notes = [_left_out(methods, len(shared))]
    courses = Counter(condition for condition, _ in shared).values()
    if min(courses) < max(courses):
        notes.append(
            f"The conditions have {min(courses)} to {max(courses)} courses each, and the row {OVERALL} weighs each "
            "condition by its number of courses."
        )
    notes += [f"{label}: driven {_driven_by(method, shared)}." for label, method in methods.items()]
    if len({method.episodes[key].get("code") for method in methods.values() for key in shared}) > 1:
        notes.append(
            "Different code drove some of these episodes, so a difference may also be that of the simulator or of the "
            "navigator; drive a method again with the code of the others to exclude that."
        )
    return notes + [note for label, method in methods.items() if (note := _unmeasured(label, method, shared))]


def failures_of(methods: Mapping[str, DrivenMethod]) -> list[dict[str, Any]]:
    """Return the failures of the compared episodes by method, outcome and cause, as count_failures does.

    Args:
        methods: By label.

    Raises:
        ValueError: The methods have no episode in common.
    """
    shared = shared_episodes(methods)
    return count_failures(
        (label, method.episodes[key]["outcome"], method.episodes[key].get("cause"))
        for label, method in methods.items()
        for key in shared
    )


def _driven_by(method: DrivenMethod, shared: Sequence[Key]) -> str:
    """Return what drove the episodes of a method that are compared: code, runtime and digests of weights."""
    states = Counter(method.episodes[key].get("code") or "an unknown state" for key in shared)
    counts = ", ".join(f"{counted(number, 'episode')} by {state}" for state, number in states.most_common())
    words = f"by different states of the code ({counts})"
    if len(states) == 1:
        words = f"by code with SHA-256 {next(iter(states))}"
    network = method.perception.partition(":")[0] == M3DEPTH
    words += f", in {method.runtime}" if network and method.runtime else ""
    return words + "".join(f", {name} with SHA-256 {digest[:SHOWN]}" for name, digest in method.weights.items())


def _unmeasured(label: str, method: DrivenMethod, shared: Sequence[Key]) -> str | None:
    """Return a sentence on the errors of the depth that some of the compared episodes of a method lack."""
    if method.perception == GROUND_TRUTH:
        return None
    episodes = [method.episodes[key] for key in shared]
    lacking = {name: sum(episode.get(name) is None for episode in episodes) for name in DEPTH_ERRORS}
    words = ", ".join(f"{name} in {counted(number, 'episode')}" for name, number in lacking.items() if number)
    return f"{label} lacks {words}: its figures for the depth rest on the others." if words else None


def _left_out(methods: Mapping[str, DrivenMethod], compared: int) -> str:
    """Return a sentence on the episodes that are compared, and on those that are left out."""
    driven = {key for method in methods.values() for key in method.episodes}
    lacking = {label: len(driven) - len(method.episodes) for label, method in methods.items()}
    lacks = ", ".join(f"{label} lacks {number}" for label, number in lacking.items() if number)
    words = f"Compared on {counted(compared, 'episode')} that all methods have driven"
    return f"{words}; others left out: {len(driven) - compared}{f' ({lacks})' if lacks else ''}."


def scores(episode: Episode) -> tuple[float, float]:
    """Return success and SPL of an episode."""
    return float(episode["success"]), float(episode["spl"])
