"""Every drive of an evaluation from above, on the rocks that were there."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from envs.ends import GOAL_RADIUS
from envs.episodes import EpisodeRecord

OUTCOME_COLOURS = {
    "goal": "#2a9d5c", "collision": "#d1495b", "tilt": "#8e44ad", "stuck": "#e08e45", "time": "#5c6b7a",
    "out_of_bounds": "#b08968", "no_path": "#264653", "elsewhere": "#3a86c8",
}  # fmt: skip
LINES = ("-", "--", ":", "-.")  # one for each driver and perception
COLUMNS, ROWS = 5, 4
AROUND = 5.0  # [m] shown before the start and behind the goal
ASIDE = 8.0  # [m] shown to either side, more where a drive went further


def plot_maps(folder: Path, records: Sequence[EpisodeRecord]) -> None:
    """Write folder/CELL-PAGE.png: a panel for each course of a cell, twenty a page.

    Each course is turned so that its goal, a star in the circle within which it counts as reached, lies to the right of
    its start, both on the middle line; rocks that block are grey discs. Colour is the outcome, the line says who drove.
    """
    folder.mkdir(parents=True, exist_ok=True)
    groups = sorted({(r.driver, r.perception) for r in records})
    for cell in sorted({r.cell for r in records}):
        own = [r for r in records if r.cell == cell]
        courses = sorted({r.episode for r in own})
        for page, start in enumerate(range(0, len(courses), COLUMNS * ROWS)):
            shown = courses[start : start + COLUMNS * ROWS]
            name = cell.replace("=", "").replace(", ", "-")
            _page(folder / f"{name}-{page}.png", cell, [[r for r in own if r.episode == e] for e in shown], groups)


def _page(path: Path, cell: str, courses: Sequence[Sequence[EpisodeRecord]], groups: Sequence[tuple[str, str]]) -> None:
    columns = min(COLUMNS, len(courses))
    rows = -(-len(courses) // columns)
    figure = Figure(figsize=(3.6 * columns, 2.5 * rows + 0.6), dpi=90, layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in panels:
        axes.set_axis_off()
    for axes, drives in zip(panels, courses):
        axes.set_axis_on()
        _panel(axes, drives, groups)
    seen = sorted({r.outcome for drives in courses for r in drives})
    handles = [panels[0].plot([], [], color=OUTCOME_COLOURS.get(o, "#333333"), label=o)[0] for o in seen]
    handles += [
        panels[0].plot([], [], "k", ls=LINES[n % len(LINES)], label=", ".join(group))[0]
        for n, group in enumerate(groups)
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=min(1 + columns, len(handles)), fontsize=8)
    figure.suptitle(cell, fontsize=10)
    figure.savefig(path)


def _panel(axes, drives: Sequence[EpisodeRecord], groups: Sequence[tuple[str, str]]) -> None:
    origin, goal = np.array(drives[0].track[0]), np.array(drives[0].goal)
    along = goal - origin
    distance = max(float(np.hypot(*along)), 1e-9)
    turn = np.array([[along[0], along[1]], [-along[1], along[0]]]) / distance
    rocks = np.array(drives[0].obstacles).reshape(-1, 3)
    discs = EllipseCollection(
        rocks[:, 2], rocks[:, 2], np.zeros(len(rocks)), units="x", offsets=(rocks[:, :2] - origin) @ turn.T,
        transOffset=axes.transData, facecolors="#9a938c",
    )  # fmt: skip
    axes.add_collection(discs)
    aside = ASIDE
    for record in drives:
        x, y = turn @ (np.array(record.track) - origin).T
        colour = OUTCOME_COLOURS.get(record.outcome, "#333333")
        line = LINES[groups.index((record.driver, record.perception)) % len(LINES)]
        axes.plot(x, y, color=colour, lw=1.3, ls=line)
        axes.plot(x[-1:], y[-1:], "o", color=colour, ms=3)
        aside = max(aside, float(np.abs(y).max()) + 1)
    axes.plot([distance], [0], "k*", ms=8)
    axes.add_patch(Circle((distance, 0), GOAL_RADIUS, fill=False, lw=0.8))
    axes.set(xlim=(-AROUND, distance + AROUND), ylim=(-aside, aside), title=f"course {drives[0].episode}")
    axes.title.set_fontsize(8)
    axes.tick_params(labelsize=6)
    axes.set_aspect("equal")
