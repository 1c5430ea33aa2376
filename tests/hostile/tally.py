"""The counts of a campaign as a table, and what it lacks of the cases that it promises."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator

from file_formats import FORMATS
from oracle import CASES, IN_PROCESSES, SEED

FLAGS, FILES = "flags", "file"  # the kinds of attack whose cases run in the process of the test
KINDS = (  # whose cases are processes
    "full disk",
    "file-size limit",
    "read-only folder",
    "links",
    "closed stream",
    "locale",
    "no home",
    "removed folder",
    "two writers",
    "taken line",
)
NEED_MOUNT = ("full disk", "read-only folder")  # kinds that are skipped where this process may mount nothing
NO_MOUNT = "may not mount a disk in memory here"  # why  # fmt: skip
IN_TEST = ("user class",)  # kinds with as many cases, most of them in the process of the test
Counts = Counter[tuple[str, str]]


def table(counts: Counts) -> str:
    """Return the counts as text: a line for each command or format, then the sums by kind."""
    by_kind, by_attacked = Counter[str](), dict[str, list[str]]()
    for (attacked, kind), number in sorted(counts.items()):
        by_kind[kind] += number
        by_attacked.setdefault(attacked, []).append(f"{number} {kind}")
    width = max(map(len, by_attacked), default=0)
    lines = [f"{attacked:{width}}  {', '.join(parts)}" for attacked, parts in by_attacked.items()]
    sums = ", ".join(f"{number} {kind}" for kind, number in by_kind.most_common())
    total = f"{counts.total()} cases of seed {SEED}, {in_processes(counts)} in processes of their own: {sums}"
    return "\n".join([*lines, "", total])


def in_processes(counts: Counts) -> int:
    """Return how many cases were processes."""
    return sum(number for (_, kind), number in counts.items() if kind in KINDS or kind.startswith("kill"))


def missing(counts: Counts, untried: Collection[str] = ()) -> list[str]:
    """Return what a campaign lacks of its cases.

    Args:
        counts: Its counts.
        untried: Kinds of attack that cannot be tried here.
    """
    return list(_missing(counts, untried))


def _missing(counts: Counts, untried: Collection[str]) -> Iterator[str]:
    wanted = 5000 * CASES // 300
    if counts.total() < wanted:
        yield f"{counts.total()} of {wanted} cases"
    if in_processes(counts) < 6 * IN_PROCESSES:
        yield f"{in_processes(counts)} of {6 * IN_PROCESSES} processes"
    for name in FORMATS:
        if counts[name, FILES] < CASES // 3:
            yield f"{counts[name, FILES]} of {CASES // 3} files of {name}"
    for kind in (*KINDS, *IN_TEST):
        number = sum(n for (_, k), n in counts.items() if k == kind)
        if number < IN_PROCESSES and kind not in untried:
            yield f"{number} of {IN_PROCESSES} cases of {kind}"
    for command in {attacked for attacked, kind in counts if kind.startswith("kill")}:
        number = sum(n for (a, k), n in counts.items() if a == command and k.startswith("kill"))
        if number < IN_PROCESSES:
            yield f"{number} of {IN_PROCESSES} kills of {command}"
