"""Drives that several files hold of one method: which of them are equal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from envs.comparison.methods import DrivenMethod
from envs.comparison.suite_results import Episode, Key
from envs.drives.records import TIMES
from marssim.base.command.wording import counted

APART = (*TIMES, "code")  # values that may differ between two drives that are equal
CAUSE = "cause"  # of a failure; null where it was not recorded
ROUNDING = 1e-9  # by which numbers may differ, relative to themselves
NAMED = 12  # episodes that a sentence names


def repeats_of(methods: Mapping[str, DrivenMethod]) -> list[dict[str, Any]]:
    """Return how the episodes of one method under several labels agree, where several files hold the same ones.

    Two episodes are equal if all of their values are but for rounding, apart from measured times and the state of the
    code. A value that only one of the files records does not count, nor does a cause that only one of them knows.

    Args:
        methods: By label.

    Returns:
        An entry for each label whose driver and perception an earlier label has too, if both have driven an episode:
        driver, perception, labels (the earlier one and this), shared (how many episodes both have), equal (how many of
        them are equal), and differing (the others: condition and course).
    """
    rows: list[dict[str, Any]] = []
    first: dict[tuple[str, str], str] = {}
    for label, method in methods.items():
        earlier = first.setdefault((method.driver, method.perception), label)
        others = methods[earlier].episodes
        shared = [key for key in others if key in method.episodes]
        if earlier == label or not shared:
            continue
        differing = [key for key in shared if not are_equal(others[key], method.episodes[key])]
        rows.append(
            {
                "driver": method.driver, "perception": method.perception, "labels": [earlier, label],
                "shared": len(shared), "equal": len(shared) - len(differing),
                "differing": [{"condition": condition, "course": course} for condition, course in differing],
            }
        )  # fmt: skip
    return rows


def are_equal(one: Episode, other: Episode) -> bool:
    """Return whether two episodes are equal but for times, code and rounding, in the values that both have."""
    names = (one.keys() & other.keys()) - {*APART}
    if one.get(CAUSE) is None or other.get(CAUSE) is None:
        names -= {CAUSE}
    return all(_is_same(one[name], other[name]) for name in names)


def _is_same(one: Any, other: Any) -> bool:
    """Return whether two values are equal; processors may round the last digits of numbers otherwise."""
    if isinstance(one, float) and isinstance(other, float):
        return math.isclose(one, other, rel_tol=ROUNDING, abs_tol=ROUNDING)
    return bool(one == other)


def repeat_in_words(row: Mapping[str, Any]) -> str:
    """Return an entry of repeats_of as a sentence."""
    one, other = row["labels"]
    words = (
        f"{one}, and {other}: {row['equal']} of {counted(row['shared'], 'shared episode')} "
        f"{'is' if row['shared'] == 1 else 'are'} equal but for times"
    )
    differing: Sequence[Key] = [(each["condition"], each["course"]) for each in row["differing"]]
    if not differing:
        return f"{words}."
    more = f", and {len(differing) - NAMED} more" if len(differing) > NAMED else ""
    return f"{words}; differing: {', '.join(f'{name} {course}' for name, course in differing[:NAMED])}{more}."
