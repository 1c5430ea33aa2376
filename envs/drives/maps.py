"""Every drive of an evaluation from above, on the true rocks."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Polygon

from envs.drives.colours import OTHER_COLOUR, OUTCOME_COLOURS, ROCK_COLOUR, WAY_COLOUR
from envs.drives.episodes import EpisodeRecord
from envs.world.referee import GOAL_RADIUS
from m3depth.figures.drawing import legend_labels, plain_label, save
from marssim.base.rover_spec import ZHURONG
from nav.path.footprint import footprint_corners

# Line styles, one for each driver and perception; a pair is an offset, and lengths of dashes and gaps.
LINES: tuple[Any, ...] = ("-", "--", ":", "-.", (0, (8, 2)), (0, (5, 1, 1, 1, 1, 1)), (0, (1, 3)), (0, (8, 2, 2, 2)))
WAY_WIDTH = 3.5
CONTOURS, MOST_CONTOURS = (0.1, 0.25, 0.5, 1.0, 2.0, 5.0), 20  # intervals [m], and the most contours on a map
END_MARKS = {  # matplotlib's marker where a drive ended, and its size [pt]: colours alone do not tell all readers apart
    "goal": ("o", 3.5), "collision": ("X", 6), "tilt": ("^", 5.5), "stuck": ("s", 4.5), "time": ("D", 4.5),
    "out_of_bounds": (">", 5.5), "no_path": ("v", 5.5), "elsewhere": ("P", 6),
}  # fmt: skip
OTHER_MARK = ("h", 5)  # of outcomes that this version does not have
COLUMNS, ROWS = 5, 4  # courses on a page
PANEL, NARROWEST = 3.6, 7.2  # [in] width of a course, and least width of a page, for its title and legend
AROUND = 5.0  # [m] shown before the start and behind the goal
ASIDE = 8.0  # [m] shown to either side, or more if a drive went farther
VALUES = r"k(preset|[\d.e+-]+)-slope(preset|[\d.e+-]+)"
PAGE = re.compile(rf"({VALUES}|condition[\w.-]+)-\d+\.png")  # names of the pages


def plot_maps(folder: Path, records: Sequence[EpisodeRecord]) -> None:
    """Write folder/CELL-PAGE.png: a panel for each course of a cell, twenty on a page. Pages of other records are
    deleted.

    Each course is turned so that its start lies to the left of its goal, both on the middle line. The goal is a star in
    the circle within which it counts as reached; rocks that block are grey discs. The colour and the mark at the end
    show the outcome, the line style who drove: LINES in the order of the records. The rover's footprint is drawn where
    it started and where each drive ended. A pale band is the shortest passable path; contours are relief, dark ones
    low.
    """
    folder.mkdir(parents=True, exist_ok=True)
    groups = list(dict.fromkeys((r.driver, r.perception) for r in records))
    written = set()
    for cell in sorted({r.cell for r in records}):
        in_cell = [r for r in records if r.cell == cell]
        courses = sorted({r.episode for r in in_cell})
        for page, start in enumerate(range(0, len(courses), COLUMNS * ROWS)):
            shown = courses[start : start + COLUMNS * ROWS]
            path = folder / f"{cell.replace('=', '').replace(', ', '-')}-{page}.png"
            _page(path, cell, [[r for r in in_cell if r.episode == e] for e in shown], groups)
            written.add(path)
    for old in set(folder.iterdir()) - written:
        if PAGE.fullmatch(old.name):
            old.unlink()


def _page(path: Path, cell: str, courses: Sequence[Sequence[EpisodeRecord]], groups: Sequence[tuple[str, str]]) -> None:
    columns = min(COLUMNS, len(courses))
    rows = -(-len(courses) // columns)
    legend = _legend(courses, groups)
    longest = max(len(str(line.get_label())) for line in legend)
    panel = max(PANEL, NARROWEST / columns)
    across = max(1, min(1 + columns, len(legend), int(panel * columns / (0.075 * longest + 0.6))))  # [in] of 8 pt
    height = panel * rows / 1.44 + 0.4 + 0.2 * -(-len(legend) // across)
    figure = Figure(figsize=(panel * columns, height), dpi=90, layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    interval = _contour_interval(courses)
    for axes in panels:
        axes.set_axis_off()
    for axes, drives in zip(panels, courses):
        axes.set_axis_on()
        _panel(axes, drives, groups, interval)
    figure.legend(handles=legend, loc="outside lower center", ncols=across, fontsize=8)
    relief = f", contours every {interval:g} m, the lower the darker" if interval else ""
    figure.suptitle(f"{plain_label(str(cell))}\n[m] from the start{relief}", fontsize=9)
    save(figure, path)


def _legend(courses: Sequence[Sequence[EpisodeRecord]], groups: Sequence[tuple[str, str]]) -> list[Line2D]:
    records = [record for drives in courses for record in drives]
    outcomes = sorted({record.outcome for record in records})
    out = []
    for outcome in outcomes:
        marker, size = END_MARKS.get(outcome, OTHER_MARK)
        colour = OUTCOME_COLOURS.get(outcome, OTHER_COLOUR)
        out.append(Line2D([], [], color=colour, marker=marker, ms=size, label=f"outcome: {outcome}"))
    out += [
        Line2D([], [], color="k", ls=LINES[n % len(LINES)], label=label)
        for n, label in enumerate(legend_labels([", ".join(group) for group in groups]))
    ]
    if any(record.shortest_path for record in records):
        out.append(Line2D([], [], color=WAY_COLOUR, lw=WAY_WIDTH, label="shortest passable path"))
    out += [
        Line2D([], [], ls="", marker="o", color=ROCK_COLOUR, label="rock that blocks"),
        Line2D([], [], ls="", marker="*", color="k", ms=8, label="goal and its circle"),
        Line2D([], [], ls="", marker="s", mfc="none", mec="k", ms=7, label="rover, start and end"),
    ]
    return out


def _contour_interval(courses: Sequence[Sequence[EpisodeRecord]]) -> float | None:
    """Return the interval of the contours of a page [m]; None if no record holds the relief."""
    ranges = [float(np.ptp(r.relief)) for drives in courses for r in drives if r.relief]
    if not ranges:
        return None
    return next((step for step in CONTOURS if max(ranges) <= MOST_CONTOURS * step), CONTOURS[-1])


def _panel(
    axes: Axes, drives: Sequence[EpisodeRecord], groups: Sequence[tuple[str, str]], interval: float | None
) -> None:
    first = drives[0]
    origin, goal = np.array(first.track[0]), np.array(first.goal)
    along = goal - origin
    distance = max(float(np.hypot(*along)), 1e-9)
    turn = np.array([[along[0], along[1]], [-along[1], along[0]]]) / distance

    def turned(points: Sequence[Sequence[float]] | np.ndarray) -> np.ndarray:
        return np.asarray((np.array(points, float).reshape(-1, 2) - origin) @ turn.T)

    aside = ASIDE
    for record in drives:  # records of earlier releases lack these, other records of the course may have them
        if record.relief and interval:
            _contours(axes, record, turned, interval)
            break
    for record in drives:
        if record.shortest_path:
            x, y = turned(record.shortest_path).T
            axes.plot(x, y, color=WAY_COLOUR, lw=WAY_WIDTH, solid_capstyle="round", zorder=1.5)
            aside = max(aside, float(np.abs(y).max()) + 1)
            break
    rocks = np.array(first.obstacles).reshape(-1, 3)
    discs = EllipseCollection(
        rocks[:, 2], rocks[:, 2], np.zeros(len(rocks)), units="x", offsets=turned(rocks[:, :2]),
        offset_transform=axes.transData, facecolors=ROCK_COLOUR, zorder=1.6,
    )  # fmt: skip
    axes.add_collection(discs)
    for record in drives:
        x, y = turned(record.track).T
        colour = OUTCOME_COLOURS.get(record.outcome, OTHER_COLOUR)
        line = LINES[groups.index((record.driver, record.perception)) % len(LINES)]
        axes.plot(x, y, color=colour, lw=1.3, ls=line)
        marker, size = END_MARKS.get(record.outcome, OTHER_MARK)
        axes.plot(x[-1:], y[-1:], marker, color=colour, ms=size)
        for at, edge in ((0, "k"), (-1, colour)):
            if record.headings:
                corners = footprint_corners(ZHURONG, (*record.track[at], record.headings[at]))
                axes.add_patch(Polygon(turned(corners), fill=False, lw=0.8, ec=edge, zorder=2.5))
                nose = [corners[:2].mean(axis=0), record.track[at]]
                axes.plot(*turned(nose).T, color=edge, lw=0.8)
        aside = max(aside, float(np.abs(y).max()) + 1)
    axes.plot([distance], [0], "k*", ms=8)
    axes.add_patch(Circle((distance, 0), GOAL_RADIUS, fill=False, lw=0.8))
    axes.set(xlim=(-AROUND, distance + AROUND), ylim=(-aside, aside), title=f"course {first.episode}")
    axes.title.set_fontsize(8)
    axes.tick_params(labelsize=6)
    axes.set_aspect("equal")


def _contours(axes: Axes, record: EpisodeRecord, turned: Callable[[np.ndarray], np.ndarray], interval: float) -> None:
    heights = np.array(record.relief)
    axis = np.linspace(-record.half, record.half, len(heights))
    x, y = turned(np.stack(np.meshgrid(axis, axis), axis=-1)).T.reshape(2, *heights.shape)
    low = np.floor(heights.min() / interval) * interval
    levels = np.arange(low, heights.max() + interval, interval)
    axes.contour(
        x,
        y,
        heights,
        levels=levels,
        cmap="Greys_r",
        vmax=heights.max() + np.ptp(heights),
        linewidths=0.6,
        alpha=0.8,
        zorder=1,
    )
