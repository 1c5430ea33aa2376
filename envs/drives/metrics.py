"""Metrics of driven episodes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from scipy.special import gammaincinv

from envs.drives.episodes import EpisodeRecord, mean_of_measured
from m3depth.evaluation.bootstrap import COVERAGE, mean_interval, student_over_normal

# outcomes by ENav's classes of failure, and one class for drives that odometry led to a wrong place
FAILURES = {
    "no feasible path": ("no_path",), "safety limit": ("collision", "tilt", "out_of_bounds"), "time": ("time", "stuck"),
    "elsewhere": ("elsewhere",),
}  # fmt: skip
UNREACHABLE_MARK = 0.20  # share of goals without a way above which the table marks a cell


def spl(success: bool, shortest: float, path_length: float) -> float:
    """Return the success weighted by path length, S L / max(P, L) (Anderson et al. 2018).

    As in Habitat, L leads to the goal itself, and the drive may end at the goal radius. L is found on a grid and may be
    2.7 % too long (envs.courses.course). Both favour detours: on 20 m, SPL is too high by up to 8 % of itself. A
    rover that gets through ground around which L leads can be better than L, and has 1.

    Args:
        success: Whether the drive arrived, S.
        shortest: Length of the shortest passable path, L [m].
        path_length: Length of the way driven, P [m].
    """
    return float(success) * shortest / max(path_length, shortest, 1e-9)


def soft_spl(start_distance: float, distance: float, shortest: float, path_length: float) -> float:
    """Return SPL with the share of the way covered instead of the success: max(0, 1 - d_T / d_0) L / max(P, L).

    Args:
        start_distance: Distance to the goal at the start, d_0 [m].
        distance: Distance to the goal at the end, d_T [m].
        shortest: Length of the shortest passable path, L [m].
        path_length: Length of the way driven, P [m].
    """
    return max(0.0, 1 - distance / max(start_distance, 1e-9)) * shortest / max(path_length, shortest, 1e-9)


def best_and_worst(records: Sequence[EpisodeRecord]) -> tuple[int | None, int]:
    """Return the indices of the arrival with the highest SPL and of the drive that covered least of its way.

    They may be the same. The first is None if no drive arrived.
    """

    def merit(n: int) -> tuple[bool, float]:
        r = records[n]
        arrived = r.outcome == "goal"
        return arrived, spl(arrived, r.shortest, r.path_length) if arrived else 1 - r.distance / r.start_distance

    order = sorted(range(len(records)), key=merit)
    return order[-1] if merit(order[-1])[0] else None, order[0]


def wilson_interval(successes: float, trials: float, z: float = 1.96) -> tuple[float, float]:
    """Return the Wilson score interval of a proportion, 95 % by default.

    Args:
        successes: Number of successes. Of trials that depend on each other: their mean a trial times `trials`.
        trials: Number of trials; of those that depend on each other, effective_drives.
        z: Quantile of the normal distribution.

    Raises:
        ValueError: Without trials.
    """
    if trials < 1:
        raise ValueError("an interval needs at least one trial")
    p, n = successes / trials, trials
    middle = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * np.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return float(max(0.0, middle - half)), float(min(1.0, middle + half))


def poisson_interval(count: int) -> tuple[float, float]:
    """Return the exact 95 % interval of the mean of a Poisson distribution (Garwood 1936).

    Args:
        count: The number that was counted.
    """
    tail = (1 - COVERAGE) / 2
    low = float(gammaincinv(count, tail)) if count else 0.0
    return low, float(gammaincinv(count + 1, 1 - tail))


def newcombe_interval(both: float, first: float, second: float, neither: float, z: float = 1.96) -> tuple[float, float]:
    """Return the hybrid score interval of the difference of two success rates over the same courses, 95 % by default.

    It joins the Wilson intervals of both rates by their correlation (Newcombe 1998, "Improved confidence intervals for
    the difference between binomial proportions based on paired data", method 10). It holds where the bootstrap fails:
    with few courses that differ, or none. Of courses that depend on each other, give the numbers times
    effective_drives over their sum.

    Args:
        both: Number of courses on which both succeeded.
        first: Number of those on which only the first did.
        second: Number of those on which only the second did.
        neither: Number of those on which neither did.
        z: Quantile of the normal distribution.

    Returns:
        Bounds of the first rate less the second.

    Raises:
        ValueError: Without courses.
    """
    n = both + first + second + neither
    p1, p2 = ((both + alone) / n if n else 0.0 for alone in (first, second))
    (low1, high1), (low2, high2) = (wilson_interval(both + alone, n, z) for alone in (first, second))
    agreement = both * neither - first * second
    agreement = max(agreement - n / 2, 0.0) if agreement > 0 else agreement  # his correction for continuity
    margins = (both + first) * (second + neither) * (both + second) * (first + neither)
    phi = agreement / np.sqrt(margins) if margins else 0.0

    def reach(one: float, other: float) -> float:
        return float(np.sqrt(one**2 - 2 * phi * one * other + other**2))

    difference = p1 - p2
    return difference - reach(p1 - low1, high2 - p2), difference + reach(high1 - p1, p2 - low2)


def effective_drives(values: np.ndarray, courses: Sequence[int]) -> float:
    """Return the effective number of drives, of which several may be on one course, and then resemble each other.

    It is the number at which independent drives would have the mean's variance over courses (Korn and Graubard 1998,
    "Confidence intervals for proportions with small expected number of positive counts estimated from survey data"),
    times the square of z / t, as that variance is known from a few courses only.

    Args:
        values: (N,) successes of drives, or differences of successes.
        courses: (N,) number of the course of each.

    Returns:
        A number from that of the different courses to N; that of the courses if all values are the same.
    """
    number = len(set(courses))
    sums: dict[int, float] = {}
    for course, value in zip(courses, values - values.mean(), strict=True):
        sums[course] = sums.get(course, 0.0) + value
    between = number / max(number - 1, 1) * float(np.square([*sums.values()]).sum())
    if between <= 1e-12 * len(values):
        return float(number)
    drives = len(values) * float(np.square(values - values.mean()).sum()) / between
    return float(np.clip(drives / student_over_normal(number) ** 2, number, len(values)))


def paired_difference(first: Sequence[EpisodeRecord], second: Sequence[EpisodeRecord]) -> dict[str, Any]:
    """Return success and SPL of `first` less those of `second` on the same episodes, with 95 % intervals.

    Records are matched by cell and episode, and every episode counts alike. The courses of one number in all cells come
    from one seed and have much of their ground in common. So the interval of success is newcombe_interval of as many
    drives as effective_drives says, which in a single cell are all. That of SPL is by the paired bootstrap, in which
    courses of one number are drawn together, as one. If all of them differ by the same amount, it has no width and says
    nothing.

    Returns:
        episodes; courses: how many numbers they have; difference, interval, spl_difference and spl_interval, None
        with fewer than FEWEST_CLUSTERS numbers.

    Raises:
        ValueError: If the two do not hold the same episodes.
    """
    a, b = ({(r.cell, r.episode): _scores(r) for r in records} for records in (first, second))
    return paired_scores(a, b)


def paired_scores(
    a: Mapping[tuple[str, int], tuple[float, float]], b: Mapping[tuple[str, int], tuple[float, float]]
) -> dict[str, Any]:
    """Return what paired_difference does, of success (0 or 1) and SPL by cell and number of the course."""
    if a.keys() != b.keys() or not a:
        raise ValueError("a paired difference needs the same episodes of both")
    keys = sorted(a)
    of_a, of_b = (np.array([scores[key] for key in keys]) for scores in (a, b))  # (episodes, 2)
    gains, courses = of_a - of_b, [course for _, course in keys]
    of_one = effective_drives(gains[:, 0], courses) / len(keys)
    pairs = Counter(zip(of_a[:, 0] > 0, of_b[:, 0] > 0, strict=True))
    counts = [of_one * pairs[both] for both in ((True, True), (True, False), (False, True), (False, False))]
    return {
        "episodes": len(keys),
        "courses": len(set(courses)),
        "difference": float(gains[:, 0].mean()),
        "interval": list(newcombe_interval(*counts)),
        "spl_difference": float(gains[:, 1].mean()),
        "spl_interval": spl_interval(gains[:, 1], courses, least=-1.0),
    }


def spl_interval(values: np.ndarray, courses: Sequence[int], least: float = 0.0) -> list[float] | None:
    """Return the 95 % interval of the mean of SPL, or of differences of it, by the bootstrap over the courses.

    Args:
        values: (N,) of the drives.
        courses: (N,) number of the course of each; drives on courses of one number are drawn together.
        least: Least value that the mean can have.

    Returns:
        Its bounds; None with fewer than FEWEST_CLUSTERS courses.
    """
    return mean_interval(values, courses, within=(least, 1.0))[1]


def _scores(record: EpisodeRecord) -> tuple[float, float]:
    """Return success and SPL of one episode."""
    arrived = record.outcome == "goal"
    return float(arrived), spl(arrived, record.shortest, record.path_length)


def summarise(records: Sequence[EpisodeRecord]) -> dict[str, Any]:
    """Return the metrics over the episodes of one driver, perception and cell.

    Returns:
        A row of results.json. path_inefficiency: mean of P / L over the arrivals; down to 0.92 on 20 m, as the drive
        ends 1 m before the goal and L may be 2.7 % too long. failures: numbers by the classes of FAILURES.
        near_miss_rate: share of episodes with near_miss. abs_rel: of the depth on the way, None with the ground truth.
        slip, energy: as of EpisodeRecord, None for wheels that do not slip.
        unreachable_share: share of the drawn courses without a way on the true ground, or with steep ground at an
            end, which were drawn again.

    Raises:
        ValueError: Without episodes.
    """
    n = len(records)
    if n == 0:
        raise ValueError("a summary needs at least one episode")
    success = [r.outcome == "goal" for r in records]
    outcomes = Counter(r.outcome for r in records)
    redraws = int(sum(r.redraws for r in records))
    driven = [r for r in records if r.outcome == "goal"]
    return {
        "episodes": n,
        "success_rate": sum(success) / n,
        "success_interval": list(wilson_interval(sum(success), n)),
        "spl": float(np.mean([_scores(r)[1] for r in records])),
        "soft_spl": float(
            np.mean([soft_spl(r.start_distance, r.distance, r.shortest, r.path_length) for r in records])
        ),
        "collision_rate": outcomes["collision"] / n,
        "tilt_rate": outcomes["tilt"] / n,
        "near_miss_rate": sum(r.near_miss for r in records) / n,
        "max_tilt_deg": float(np.max([r.max_tilt_deg for r in records])),
        "failures": {name: sum(outcomes[o] for o in members) for name, members in FAILURES.items()},
        "outcomes": dict(sorted(outcomes.items())),
        "path_inefficiency": float(np.mean([r.path_length / r.shortest for r in driven])) if driven else None,
        "min_clearance": float(np.min([r.min_clearance for r in records])),
        "steps": float(np.mean([r.steps for r in records])),
        "step_seconds": float(np.mean([r.step_seconds for r in records])),
        "perception_seconds": float(np.mean([r.perception_seconds for r in records])),
        "abs_rel": mean_of_measured([r.abs_rel for r in records]),
        "slip": mean_of_measured([r.slip for r in records]),
        "energy": mean_of_measured([r.energy for r in records]),
        "redraws": redraws,
        "unreachable_share": redraws / (redraws + n),
    }


def count_failures(drives: Iterable[tuple[str, str, str | None]]) -> list[dict[str, Any]]:
    """Return method, outcome, cause and number of the failures, the most frequent of each method first.

    Args:
        drives: Name of the method, outcome, and cause of each drive, as records of episodes have them.
    """
    counts = Counter(drive for drive in drives if drive[1] != "goal")
    methods = list(dict.fromkeys(method for method, _, _ in counts))
    return [
        {"method": method, "outcome": outcome, "cause": cause, "failures": number}
        for (method, outcome, cause), number in sorted(
            counts.items(), key=lambda item: (methods.index(item[0][0]), -item[1])
        )
    ]
