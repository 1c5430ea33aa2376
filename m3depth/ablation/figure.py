"""The figure of a study: the paper's changes of the errors beside ours."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from textwrap import fill
from typing import Any

from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator

from m3depth.figures.drawing import METHOD_COLOURS, save

# Figures that have a panel, and its title.
SHOWN = {"abs_rel": "Abs Rel", "rmse": "RMSE", "normal_mean": "mean error of the normals"}
BARS = {"interval": 3, "seed_interval": 1}  # widths of the bars of intervals [pt]
LABEL = 40  # characters of a line of a row's label; two lines fit
PAPER, HERE = METHOD_COLOURS[1], METHOD_COLOURS[0]  # colours of the marks


def study_figure(study: Mapping[str, Any], path: Path) -> None:
    """Write a PNG of how much each row's errors differ from the reference row's, in the paper and here.

    Thick bars are the 95 % intervals over test scenes, thin ones those over seeds, where there are several.

    Args:
        study: The result of m3depth.ablation.findings.findings.
        path: The file to write.
    """
    names = [name for name in SHOWN if name in study["columns"]]
    changes = [row["against_reference"][name] for row in study["rows"] for name in names]
    has_seeds = any(change["seed_interval"] for change in changes)
    over_scenes = "95 % interval over test scenes" + ("" if has_seeds else ", without chance in training")
    rows = study["rows"]
    gap = 0.14 if study["source"] else 0.0  # from a row's label up to the paper's mark, and down to ours
    figure = Figure(figsize=(1.6 + 3.6 * len(names), 1.6 + 0.42 * len(rows)), layout="constrained", dpi=120)
    panels = figure.subplots(1, len(names), sharey=True, squeeze=False)[0]
    for ax, name in zip(panels, names, strict=True):
        ax.axvline(0, color="0.6", lw=1, zorder=1)
        for place, row in enumerate(rows):
            change = row["against_reference"][name]
            if change["paper"] is not None:
                ax.plot(100 * change["paper"], place - gap, marker="D", ms=6, color=PAPER, mfc="white", mew=1.6, ls="")
            if change["here"] is not None:
                for name_of_bounds, width in BARS.items():
                    bounds = [100 * bound for bound in change[name_of_bounds] or ()]
                    ax.plot(bounds, [place + gap] * len(bounds), color=HERE, lw=width)
                ax.plot(100 * change["here"], place + gap, marker="o", ms=6, color=HERE, ls="")
        ax.set_title(SHOWN[name], fontsize=11)
        ax.xaxis.set_major_locator(MaxNLocator(5))
        ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:+g}" if value else "0"))
        ax.grid(True, axis="x", color="0.9")
        ax.spines[["top", "right", "left"]].set_visible(False)
        ax.tick_params(axis="y", length=0)
    panels[0].set_yticks(range(len(rows)), [fill(row["label"], LABEL) for row in rows])
    if all(row["label"].isdigit() for row in rows):
        panels[0].set_ylabel(fill(study["title"].partition(",")[0], LABEL // 2))
    panels[0].set_ylim(len(rows) - 0.5, -0.5)
    handles = panels[0].plot([], [], marker="D", ms=6, color=PAPER, mfc="white", mew=1.6, ls="", label="paper")
    handles = [
        *(handles if study["source"] else []),
        panels[0].plot([], [], marker="o", ms=6, color=HERE, lw=BARS["interval"], label=f"here, {over_scenes}")[0],
    ]
    if has_seeds:
        handles += panels[0].plot([], [], color=HERE, lw=BARS["seed_interval"], label="95 % interval over seeds")
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles), frameon=False)
    reference = rows[study["reference"]]["label"]
    figure.supxlabel(f'change of the error from that of the row "{reference}" [%]', fontsize=10)
    save(figure, path)
