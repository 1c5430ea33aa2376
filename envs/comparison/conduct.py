"""How the methods drove: steps, looks, time, safety and way, over the compared episodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from envs.comparison.methods import DrivenMethod, shared_episodes
from envs.comparison.suite_results import Episode
from envs.drives.episodes import NEAR_MISS, is_near_miss
from envs.drives.metrics import poisson_interval
from envs.drives.report import bounds
from marssim.base.files.markdown import in_table

HEADS = (
    "method", "drives", "steps", "looks", "perception [s a look]", "near misses", "collisions",
    "collisions a km (95 %)", "way over shortest",
)  # fmt: skip


def conduct_of(methods: Mapping[str, DrivenMethod]) -> list[dict[str, Any]]:
    """Return how each method drove, over the episodes that all methods have driven.

    Args:
        methods: By label.

    Returns:
        A row for each method: method; episodes; steps (mean number); looks (mean number); perception_seconds (mean time
        for a look, without the first look of a drive, whose time is not recorded); near_misses (number of drives, see
        envs.drives.episodes.is_near_miss); collisions (number of drives); kilometres (way of all drives);
        collisions_per_km with collisions_per_km_interval (poisson_interval); path_inefficiency (mean of the way over
        the shortest path, of the drives that arrived). None where no drive, or for near_misses not every drive, has
        what it needs.

    Raises:
        ValueError: The methods have no episode in common.
    """
    shared = shared_episodes(methods)
    return [_row(label, [method.episodes[key] for key in shared]) for label, method in methods.items()]


def _row(label: str, drives: Sequence[Episode]) -> dict[str, Any]:
    looks = [drive["looks"] for drive in drives if drive.get("looks") is not None]
    clearances = [drive.get("min_clearance") for drive in drives]
    misses = [is_near_miss(drive["outcome"], c) for drive, c in zip(drives, clearances, strict=True) if c is not None]
    collisions = sum(drive["outcome"] == "collision" for drive in drives)
    kilometres = sum(drive["path_length"] for drive in drives) / 1000
    ends = poisson_interval(collisions)
    return {
        "method": label,
        "episodes": len(drives),
        "steps": float(np.mean([drive["steps"] for drive in drives])),
        "looks": float(np.mean(looks)) if looks else None,
        "perception_seconds": _seconds_a_look(drives),
        "near_misses": None if None in clearances else sum(misses),
        "collisions": collisions,
        "kilometres": kilometres,
        "collisions_per_km": collisions / kilometres if kilometres else None,
        "collisions_per_km_interval": [end / kilometres for end in ends] if kilometres else None,
        "path_inefficiency": _way_over_shortest([drive for drive in drives if drive["success"]]),
    }


def _seconds_a_look(drives: Sequence[Episode]) -> float | None:
    """Return the mean time of the perception for a look; None where times or looks were not recorded."""
    timed = [d for d in drives if d.get("looks") is not None and d.get("perception_seconds") is not None]
    looks = sum(drive["looks"] - 1 for drive in timed)
    return sum(drive["steps"] * drive["perception_seconds"] for drive in timed) / looks if looks else None


def _way_over_shortest(arrivals: Sequence[Episode]) -> float | None:
    ratios = [drive["path_length"] / drive["shortest"] for drive in arrivals if drive["shortest"] > 0]
    return float(np.mean(ratios)) if ratios else None


def conduct_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the rows of conduct_of as a Markdown table, with a note on what the columns are."""
    lines = [f"| {' | '.join(HEADS)} |", "|---" * len(HEADS) + "|"]
    for row in rows:
        rate, ends = row["collisions_per_km"], row["collisions_per_km_interval"]
        cells = (
            in_table(row["method"]), f"{row['episodes']}", f"{row['steps']:.0f}", _number(row["looks"], ".0f"),
            _number(row["perception_seconds"], ".2f"), _number(row["near_misses"], "d"), f"{row['collisions']}",
            f"{_number(rate, '.2f')}{bounds(ends, 1, '.2f')}", _number(row["path_inefficiency"], ".2f"),
        )  # fmt: skip
        lines.append(f"| {' | '.join(cells)} |")
    note = (
        "Steps and looks are means over the drives. The time of the perception is the mean for a look, on the machine "
        f"that drove. A near miss is a drive that came nearer than {NEAR_MISS:.2f} m to an obstacle without a "
        "collision. The interval of collisions a km is exact for a Poisson count, and takes the drives as independent, "
        "though they share courses. Way over shortest is the mean ratio of the way to the shortest path, of the drives "
        "that arrived. -: not recorded, or no such drive."
    )
    return "\n".join([*lines, "", note]) + "\n"


def _number(value: float | None, digits: str) -> str:
    return "-" if value is None else f"{value:{digits}}"
