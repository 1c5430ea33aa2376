"""The results of an evaluation as a page for the browser: tables, failures by cause, and a link to each record."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from envs.drives.episodes import NEAR_MISS, Cell, EpisodeRecord
from envs.drives.metrics import best_and_worst, count_failures, spl, summarise
from envs.drives.report import UNKNOWN_CAUSE, difference_in_words, settings
from envs.recording.drive_page import DRIVES, asset, drive_path
from envs.recording.page_colours import colour_rules, outcome_style
from envs.world.referee import GOAL_RADIUS
from marssim.base.files.atomic import write_atomically
from marssim.base.files.json_file import read_json

RESULTS = "results.html"
COLUMNS = {
    "driver": lambda row: row["driver"],
    "perception": lambda row: row["perception"],
    "episodes": lambda row: str(row["episodes"]),
    "success (95 %)": lambda row: (
        f"{100 * row['success_rate']:.0f} % ({100 * row['success_interval'][0]:.0f}-"
        f"{100 * row['success_interval'][1]:.0f})"
    ),
    "SPL": lambda row: f"{row['spl']:.2f}",
    "collisions": lambda row: f"{100 * row['collision_rate']:.0f} %",
    "near misses": lambda row: f"{100 * row['near_miss_rate']:.0f} %",
    "Abs Rel": lambda row: "-" if row["abs_rel"] is None else f"{row['abs_rel']:.4f}",
}
LEGEND = f"""\
Success: the rover came within {GOAL_RADIUS:g} m of the goal; with Wilson's interval. SPL: success times the shortest
path over the driven one. Collisions: of the chassis, or of a wheel with a rock that blocks. Abs Rel: error of the depth
on the way. Near miss: a drive without a collision whose footprint came within {100 * NEAR_MISS:.0f} cm of such a rock,
a drop or steep ground. results.md has more columns."""
FILMED = "videos.json"  # file in OUT with the record's file of each film
BEST, WORST = "best.mp4", "worst.mp4"  # films in OUT
HOW_TO_RECORD = {
    "none": "No drive is recorded. Run envs.evaluate with --record failures or --record all to record drives. To "
    "record joined results, run each shard so before envs.join.",
    "failures": "No drive failed, so that none is recorded. Run envs.evaluate with --record all to record all drives.",
}
BROKEN = "The recorded drives have no pages, since their files are broken. Run envs.report on this folder to see why."


def write_results_page(
    out: Path, content: Mapping[str, Any], records: Sequence[EpisodeRecord], episode_files: Sequence[str]
) -> None:
    """Write results.html: the settings, all drives together, failures by cause, and the tables of each cell.

    Args:
        out: The folder of the evaluation.
        content: The content of results.json.
        records: The records of all drives.
        episode_files: Names of the files of the records, in their order.
    """
    pages = {
        (r.driver, r.perception, r.cell, r.episode): page
        for r, file in zip(records, episode_files, strict=True)
        if (page := drive_path(out, file).with_suffix(".html")).is_file()
    }
    cells = list(dict.fromkeys(r.cell for r in records))
    sections = [
        _section(cell, n, content, [r for r in records if r.cell == cell], pages) for n, cell in enumerate(cells)
    ]
    title = escape(out.resolve().name)
    ends = _best_and_worst_files(records, episode_files)
    text = f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline'">
<title>Results of {title}</title>
<style>
{asset("page.css")}
{colour_rules()}
{asset("results.css")}
</style>
</head>
<body>
<main class="results">
<h1>Results of {title}</h1>
<p class="note">{escape(settings(content["driven_with"]).strip())}</p>
{_together(cells, content, records)}
{_failures(records, pages)}
{"".join(sections)}
<p class="note">{escape(LEGEND)}</p>
<p>{_files(out, ends)} {"" if pages else _why_no_pages(out, content["config"]["record"], records)}</p>
</main>
</body>
</html>
"""
    write_atomically(out / RESULTS, text.encode(errors="backslashreplace"))  # file names may be no UTF-8


def _why_no_pages(out: Path, record: str, records: Sequence[EpisodeRecord]) -> str:
    """Return why no drive has a page, as far as the folder and --record tell; "" if they do not."""
    if any((out / DRIVES).glob("*.zip")):  # also of joined results, whose shards have --record
        return BROKEN
    if record == "none" or (record == "failures" and all(r.outcome == "goal" for r in records)):
        return HOW_TO_RECORD[record]
    return ""


def _together(cells: Sequence[str], content: Mapping[str, Any], records: Sequence[EpisodeRecord]) -> str:
    """Return the section on all drives: a row for each method, the differences, and links to the cells.

    With one cell, it has only the differences; it is empty if there are none.
    """
    methods = list(dict.fromkeys((r.driver, r.perception) for r in records))
    differences = "".join(f"<p>{escape(difference_in_words(row))}</p>" for row in content["differences"])
    if len(cells) == 1:
        return f'<section class="panel">{differences}</section>' if differences else ""
    rows = []
    for driver, perception in methods:
        drives = [r for r in records if (r.driver, r.perception) == (driver, perception)]
        rows.append({"driver": driver, "perception": perception, **summarise(drives)})
    columns = {"success" if name.startswith("success") else name: show for name, show in COLUMNS.items()} | {
        "success": lambda row: f"{100 * row['success_rate']:.0f} %"
    }  # without an interval: the same course under two conditions is not two independent drives
    links = ", ".join(f'<a href="#cell-{n}">{escape(cell)}</a>' for n, cell in enumerate(cells))
    return f"""<section class="panel">
<h2>all drives</h2>
{_summary(columns, rows)}
{differences}
<p>{links}</p>
</section>
"""


def _failures(records: Sequence[EpisodeRecord], pages: Mapping[tuple[str, str, str, int], Path]) -> str:
    """Return the table of failures by outcome and cause, with links to their drives; "" if no drive failed."""
    failed: dict[tuple[str, str, str | None], list[EpisodeRecord]] = {}
    for r in records:
        failed.setdefault((f"{r.driver}, {r.perception}", r.outcome, r.cause), []).append(r)
    rows = "".join(
        f"<tr><td>{escape(row['method'])}</td><td>{escape(row['outcome'].replace('_', ' '))}</td>"
        f"<td>{escape(row['cause'] or UNKNOWN_CAUSE)}</td><td>{row['failures']}</td>"
        f'<td class="where">{_courses(failed[row["method"], row["outcome"], row["cause"]], pages)}</td></tr>'
        for row in count_failures((f"{r.driver}, {r.perception}", r.outcome, r.cause) for r in records)
    )
    if not rows:
        return ""
    return f"""<section class="panel">
<h2>failures</h2>
<table><thead><tr><th>method</th><th>outcome</th><th>cause</th><th>failures</th>
<th class="where">courses</th></tr></thead>
<tbody>{rows}</tbody></table>
</section>
"""


def _courses(records: Sequence[EpisodeRecord], pages: Mapping[tuple[str, str, str, int], Path]) -> str:
    """Return the courses of drives, each with a link to its page if it is recorded."""
    links = []
    for r in records:
        name = escape(f"{r.cell.removeprefix('condition=')}: {r.episode}")
        page = pages.get((r.driver, r.perception, r.cell, r.episode))
        links.append(name if page is None else f'<a href="{_address(page)}">{name}</a>')
    return ", ".join(links)


def _summary(columns: Mapping[str, Callable[[Mapping[str, Any]], str]], rows: Sequence[Mapping[str, Any]]) -> str:
    """Return a table with a row for each method; columns: the text of a cell, by their heads."""
    head = "".join(f"<th>{escape(name)}</th>" for name in columns)
    body = "".join(f"<tr>{''.join(f'<td>{escape(show(row))}</td>' for show in columns.values())}</tr>" for row in rows)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def _address(page: Path) -> str:
    """Return the address of a drive's page on that of the results."""
    return escape(f"{page.parent.name}/{page.name}")


def _section(
    cell: str,
    number: int,
    content: Mapping[str, Any],
    records: Sequence[EpisodeRecord],
    pages: Mapping[tuple[str, str, str, int], Path],
) -> str:
    """Return the tables of one cell: the summary of each method, and every drive."""
    methods = list(dict.fromkeys((r.driver, r.perception) for r in records))
    rows = [row for row in content["results"] if _cell_name(row["cell"]) == cell]
    by_course: dict[int, dict[tuple[str, str], EpisodeRecord]] = {}
    for record in records:
        by_course.setdefault(record.episode, {})[record.driver, record.perception] = record
    names = "".join(f'<th scope="col">{escape(", ".join(method))}</th>' for method in methods)
    drives = "".join(
        f'<tr><th scope="row">course {course}</th>'
        f"{''.join(_drive(by_method.get(method), pages) for method in methods)}</tr>"
        for course, by_method in sorted(by_course.items())
    )
    return f"""<section class="panel" id="cell-{number}">
<h2>{escape(cell)}</h2>
{_summary(COLUMNS, rows)}
<table class="drives"><thead><tr><td></td>{names}</tr></thead><tbody>{drives}</tbody></table>
</section>
"""


def _cell_name(cell: Mapping[str, Any]) -> str:
    return Cell(**cell).name


def _drive(record: EpisodeRecord | None, pages: Mapping[tuple[str, str, str, int], Path]) -> str:
    """Return a cell of the table of drives: the outcome, SPL, and the link to its page."""
    if record is None:
        return "<td></td>"
    outcome = escape(record.outcome.replace("_", " "))
    badge = f'<span class="badge" style="{outcome_style(record.outcome)}">{outcome}</span>'
    words = f"{record.path_length:.1f} m"
    if record.outcome == "goal":
        words = f"SPL {spl(True, record.shortest, record.path_length):.2f}, {words}"
    if record.near_miss:
        words += ", near miss"
    if record.cause is not None:
        words += f", {escape(record.cause)}"
    page = pages.get((record.driver, record.perception, record.cell, record.episode))
    if page is None:
        return f"<td>{badge} {words}</td>"
    return f'<td><a href="{_address(page)}">{badge} {words}, inspect</a></td>'


def _best_and_worst_files(records: Sequence[EpisodeRecord], files: Sequence[str]) -> dict[str, str | None]:
    """Return the names of the records' files of the best and of the worst drive, by their films; None for no drive."""
    if not records:
        return {}
    best, worst = best_and_worst(records)
    return {BEST: None if best is None else files[best], WORST: files[worst]}


def _files(out: Path, ends: Mapping[str, str | None]) -> str:
    """Return links to the other files of the evaluation.

    Args:
        out: Its folder, in which films of an earlier run with other drives may lie.
        ends: Of _best_and_worst_files.
    """
    noted = out / FILMED
    filmed = read_json(noted) if noted.is_file() else {}
    names = ["results.json", "results.md", "success.png"]
    names += [path.relative_to(out).as_posix() for path in sorted(out.glob("maps/*"))]
    names += [name for name, file in ends.items() if file and filmed.get(name) == file and (out / name).is_file()]
    names += [path.relative_to(out).as_posix() for path in sorted(out.glob("videos/*.mp4"))]
    links = ", ".join(f'<a href="{escape(name)}">{escape(name)}</a>' for name in names)
    return f"Beside this page: {links}."
