"""The page of an evaluation: settings, table, differences and pictures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from envs.drives.episodes import NEAR_MISS, Cell, EpisodeRecord
from envs.drives.metrics import UNREACHABLE_MARK, count_failures
from envs.world.referee import GOAL_RADIUS
from m3depth.evaluation.bootstrap import FEWEST_CLUSTERS
from m3depth.evaluation.running_sums import NEAR_GROUND
from marssim.base.files.atomic import write_atomically
from marssim.base.files.markdown import in_table

LEGEND = f"""\
Success: the rover came within {GOAL_RADIUS:g} m of the goal; with Wilson's interval. SPL, SoftSPL: success, or the
share of the distance covered, times the shortest path over the driven one. P / L: driven over shortest path, of the
drives that arrived; a drive ends before the goal, so this may be below 1. Collisions: of the chassis, or of a wheel
with a rock that blocks. Near misses: drives without a collision whose footprint came within {100 * NEAR_MISS:.0f} cm of
such a rock, a drop or steep ground. No path: the driver gave up. Safety: collision, tilt or out of bounds. Time: time
ran out, or the rover was stuck. Elsewhere: by its odometry the driver believed that it was at the goal, and it was not.
Tilt: the largest. Abs Rel: error of the depth on the way, where unknown depth counts as 80 m. Unreachable: share of the
drawn courses without a path, or with steep ground at an end, which were drawn again. s / step: seconds of driver,
perception and simulation. Differences (below) have 95 % intervals: that of success is Newcombe's for paired
proportions, that of SPL by the paired bootstrap over the courses. Drives on courses of one number, which resemble each
other, count as fewer."""

NO_INTERVAL = "no interval: all courses differ by the same amount, so the bootstrap says nothing about other courses"
FEW_COURSES = f"no interval: fewer than {FEWEST_CLUSTERS} courses"
LEAST_WIDTH = 1e-9  # of an interval; sums in another order differ by less
UNKNOWN_CAUSE = "unknown"
RECORDS_CAUSES = "navigator"  # the driver whose failures have a cause once they are recorded
HOW_CAUSES_ARE_KNOWN = "To learn the unknown causes, drive with `--record failures`, which repeats only those.\n"


def write_report(out: Path, content: dict[str, Any], records: Sequence[EpisodeRecord]) -> None:
    """Write results.md, success.png and maps/ into a folder.

    Args:
        out: The folder.
        content: The content of results.json.
        records: The records of all drives.
    """
    from envs.drives.maps import plot_maps  # not at the top, since it loads matplotlib
    from envs.drives.plots import plot_success

    head = settings(content["driven_with"]) + states_of_the_code(records)
    page = f"{head}\n{table(content['results'])}\n{differences(content['differences'])}"
    page += failures(records) + looks_without_depth(records) + ground_as_sky(records) + soil(content["results"])
    write_atomically(out / "results.md", (page + errors_beside(content["test_set_abs_rel"], records)).encode())
    plot_success(out / "success.png", content["results"], records, content["test_set_abs_rel"])
    plot_maps(out / "maps", records)


def without_definitions(page: str) -> str:
    """Return results.md without the definitions of the table's columns, for a terminal."""
    return page.replace(f"{LEGEND}\n\n", "")


def settings(driven_with: Mapping[str, Any]) -> str:
    """Return a line with the flags for which the table holds. driven_with: values by flag, without its dashes.

    A suite fixes the flags beside it, so it is named alone.
    """
    flags = []
    for name, value in driven_with.items():
        if "suite" in driven_with and name not in ("suite", "split"):
            continue
        flag = name.replace("_", "-")
        flags.append(f"--{flag} {value}" if not isinstance(value, bool) else f"--{flag}" if value else f"--no-{flag}")
    return f"Driven with {', '.join(flags)}.\n"


def states_of_the_code(records: Sequence[EpisodeRecord]) -> str:
    """Return a line that warns if different sources drove the episodes, as after an edit between two runs; else ""."""
    states = Counter(record.code or "an unknown one" for record in records)
    if len(states) == 1:
        return ""
    counts = ", ".join(f"{number} by {state}" for state, number in states.most_common())
    return (
        f"\nThe episodes were driven by different states of the code: {counts}. Delete `episodes` to drive all again.\n"
    )


def table(results: Sequence[dict[str, Any]]) -> str:
    """Return a Markdown table with a row for each driver, perception and cell."""
    condition = any("condition" in r["cell"] for r in results)
    head = (
        f"| driver | perception |{' condition |' if condition else ''} k | slope | episodes | success (95 %) | SPL "
        "| SoftSPL | P / L | collisions "
        "| near misses | no path, safety, time, elsewhere | tilt | Abs Rel | unreachable | s / step |"
    )
    lines = [head, "|" + "---|" * (head.count("|") - 1)]
    marked = False
    for r in results:
        low, high = r["success_interval"]
        unset = "-" if "condition" in r["cell"] else "preset"  # the condition sets it, or the preset
        k, slope = ((unset if v is None else f"{v:g}") for v in (r["cell"]["k"], r["cell"]["slope_deg"]))
        mark = " *" if r["unreachable_share"] > UNREACHABLE_MARK else ""
        marked |= bool(mark)
        detour = "-" if r["path_inefficiency"] is None else f"{r['path_inefficiency']:.2f}"
        error = "-" if r["abs_rel"] is None else f"{r['abs_rel']:.4f}"
        failures = ", ".join(str(number) for number in r["failures"].values())
        lines.append(
            f"| {in_table(r['driver'])} | {in_table(r['perception'])} "
            f"{'| ' + r['cell']['condition'] + ' ' if condition else ''}"
            f"| {k} | {slope}{mark} | {r['episodes']} "
            f"| {100 * r['success_rate']:.0f} % ({100 * low:.0f}-{100 * high:.0f}) | {r['spl']:.2f} "
            f"| {r['soft_spl']:.2f} | {detour} | {100 * r['collision_rate']:.0f} % | {100 * r['near_miss_rate']:.0f} % "
            f"| {failures} | {r['max_tilt_deg']:.0f} deg | {error} | {100 * r['unreachable_share']:.0f} % "
            f"| {r['step_seconds']:.2f} |"
        )
    lines += ["", LEGEND]
    if marked:
        share = f"{100 * UNREACHABLE_MARK:.0f} %"
        lines += ["", f"\\* More than {share} of the drawn courses had no path, or steep ground at an end."]
    return "\n".join(lines) + "\n"


def errors_beside(test_set: Mapping[str, float], records: Sequence[EpisodeRecord]) -> str:
    """Return lines with each perception's depth error on the way, mean over the drives, and on the test set.

    Args:
        test_set: Abs Rel on the test set by perception; others are left out.
        records: The records of all drives.
    """
    lines = []
    for perception, error in test_set.items():
        errors = [r.abs_rel for r in records if r.perception == perception and r.abs_rel is not None]
        if errors:
            way = sum(errors) / len(errors)
            ways = f"{way:.4f} on the way ({len(errors)} drives), {error:.4f} on the test set"
            lines.append(f"{in_table(perception)}: Abs Rel {ways}\n")
    return "".join(lines)


def failure_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the rows of count_failures as a Markdown table; methods as text of such a table. "" if there are none."""
    if not rows:
        return ""
    lines = [
        f"| {r['method']} | {in_table(r['outcome']).replace('_', ' ')} | {r['cause'] or UNKNOWN_CAUSE} "
        f"| {r['failures']} |"
        for r in rows
    ]
    return "\n".join(["| method | outcome | cause | failures |", "|---|---|---|---|", *lines]) + "\n"


def failures(records: Sequence[EpisodeRecord]) -> str:
    """Return the table of failures by outcome and cause, and how to learn unknown ones; "" if no drive failed."""
    rows = count_failures((in_table(f"{r.driver}, {r.perception}"), r.outcome, r.cause) for r in records)
    if not rows:
        return ""
    unknown = any(r.driver == RECORDS_CAUSES and r.cause is None and r.outcome != "goal" for r in records)
    return f"\n{failure_table(rows)}\n{HOW_CAUSES_ARE_KNOWN if unknown else ''}"


def soil(results: Sequence[Mapping[str, Any]]) -> str:
    """Return lines with the mean slip and the energy of each row of the table; none for wheels that do not slip."""
    lines = []
    for row in results:
        if row["energy"] is not None:
            slip = "" if row["slip"] is None else f"slip of {100 * row['slip']:.1f} %, "
            name = f"{in_table(row['driver'])}, {in_table(row['perception'])}, {Cell(**row['cell']).name}"
            lines.append(f"{name}: {slip}{row['energy'] / 1000:.2f} kJ of the wheels' motors a drive\n")
    return "".join(lines)


def looks_without_depth(records: Sequence[EpisodeRecord]) -> str:
    """Return lines that warn of perceptions that measured nothing of the ground within range in some of their looks."""
    lines = []
    for perception in sorted({r.perception for r in records}):
        noted = [r for r in records if r.perception == perception and r.blind is not None]
        blind, looks = sum(r.blind or 0 for r in noted), sum(r.looks or r.steps + 1 for r in noted)
        if blind:
            share = f"{100 * blind / looks:.0f} %" if blind >= 0.01 * looks else "under 1 %"
            lines.append(f"\n{in_table(perception)} gave no depth at all in {blind} of its {looks} looks ({share}).\n")
    return "".join(lines)


def ground_as_sky(records: Sequence[EpisodeRecord]) -> str:
    """Return lines with how much of the near ground each perception took for sky; none where that was not recorded."""
    lines = []
    for perception in sorted({r.perception for r in records}):
        noted = [
            r for r in records if r.perception == perception and r.near_ground and r.near_ground_as_sky is not None
        ]
        if noted:
            share = sum(r.near_ground_as_sky or 0 for r in noted) / sum(r.near_ground or 0 for r in noted)
            lines.append(
                f"\n{in_table(perception)} took {100 * share:.3g} % of the ground within {NEAR_GROUND:g} m for sky.\n"
            )
    return "".join(lines)


def differences(rows: Sequence[dict[str, Any]]) -> str:
    """Return lines with the differences of success and SPL on the same episodes."""
    return "".join(f"{in_table(difference_in_words(row))}\n" for row in rows)


def difference_in_words(row: Mapping[str, Any]) -> str:
    """Return the differences of one method from the first, with their intervals."""
    return (
        f"{row['driver']}, {row['perception']} less {', '.join(row['less'])}, paired, {row['episodes']} episodes: "
        f"{100 * row['difference']:+.0f} points of success{bounds(row['interval'], 100, '+.0f')}, "
        f"SPL {row['spl_difference']:+.2f}{bounds(row['spl_interval'], 1, '+.2f')}{_without(row)}"
    )


def bounds(ends: Sequence[float] | None, scale: float, digits: str) -> str:
    """Return an interval in words, such as " (0.71 to 0.84)"; "" if there is none, or it has no width."""
    if ends is None or not ends[1] - ends[0] > LEAST_WIDTH:
        return ""
    return f" ({scale * ends[0]:{digits}} to {scale * ends[1]:{digits}})"


def _without(row: Mapping[str, Any]) -> str:
    """Return a remark on an SPL without an interval."""
    reason = FEW_COURSES if row["courses"] < FEWEST_CLUSTERS else NO_INTERVAL
    return "" if bounds(row["spl_interval"], 1, "") else f" ({reason})"
