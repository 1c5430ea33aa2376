"""Tables and pictures of an evaluation."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from envs.episodes import EpisodeRecord

OUTCOME_COLOURS = {
    "goal": "#2a9d5c", "collision": "#d1495b", "tilt": "#8e44ad", "stuck": "#e08e45", "time": "#5c6b7a",
    "out_of_bounds": "#b08968", "no_path": "#264653",
}  # fmt: skip


def write_report(out: Path, results: Sequence[dict[str, Any]], records: Sequence[EpisodeRecord]) -> None:
    """Write results.md and map.png into a folder."""
    (out / "results.md").write_text(table(results))
    plot_tracks(out / "map.png", records)


def table(results: Sequence[dict[str, Any]]) -> str:
    """Markdown table, a row for each driver, perception and cell."""
    head = "| driver | perception | k | slope | episodes | success (95 %) | SPL | SoftSPL | collisions | s / step |"
    lines = [head, "|---|---|---|---|---|---|---|---|---|---|"]
    for r in results:
        low, high = r["success_interval"]
        k, slope = (("preset" if v is None else f"{v:g}") for v in (r["cell"]["k"], r["cell"]["slope_deg"]))
        lines.append(
            f"| {r['driver']} | {r['perception']} | {k} | {slope} | {r['episodes']} "
            f"| {100 * r['success_rate']:.0f} % ({100 * low:.0f}-{100 * high:.0f}) | {r['spl']:.2f} "
            f"| {r['soft_spl']:.2f} | {100 * r['collision_rate']:.0f} % | {r['step_seconds']:.2f} |"
        )
    return "\n".join(lines) + "\n"


def plot_tracks(path: Path, records: Sequence[EpisodeRecord]) -> None:
    """All drives from above, each turned so that its goal lies to the right of its start; colour is the outcome."""
    groups = sorted({(r.driver, r.perception) for r in records})
    figure = Figure(figsize=(4.6 * len(groups), 4.4), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    for n, group in enumerate(groups):
        axes = figure.add_subplot(1, len(groups), n + 1)
        seen = set()
        for record in (r for r in records if (r.driver, r.perception) == group):
            track, goal = np.array(record.track), np.array(record.goal)
            along = goal - track[0]
            distance = float(np.hypot(*along))
            turn = np.array([[along[0], along[1]], [-along[1], along[0]]]) / distance
            x, y = turn @ (track - track[0]).T
            label = record.outcome if record.outcome not in seen else None
            seen.add(record.outcome)
            colour = OUTCOME_COLOURS.get(record.outcome, "#333333")
            axes.plot(x, y, color=colour, lw=1.2, alpha=0.8, label=label)
            axes.plot(x[-1:], y[-1:], "o", color=colour, ms=4)
            axes.plot([distance], [0], "k*", ms=9)
        axes.set(title=f"{group[0]}, {group[1]}", xlabel="towards the goal [m]", ylabel="to the left [m]")
        axes.set_aspect("equal", adjustable="datalim")
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8, loc="upper left")
    figure.savefig(path)
