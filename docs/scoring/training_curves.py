"""The figure of the errors on validation pairs during the trainings of docs/scoring/compare_methods.py."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from m3depth.figures.drawing import method_styles, save


def curves_figure(runs: Mapping[str, Mapping[str, Any]], path: Path) -> None:
    """Write a PNG of the errors of disparity and of normals on validation pairs over the training's processor time.

    The disparity of a method for normals is that of M3Depth or the true one, so that its curve is flat or missing. The
    panel of the normals is left out where no method has any.
    """
    panels = {"epe": "EPE on validation pairs [px]", "normal": "mean error of the normals on validation pairs [°]"}
    if not any(point["normal"] for run in runs.values() for point in run["validations"]):
        del panels["normal"]
    drawing = Figure(figsize=(7 * len(panels), 4.4), layout="constrained", dpi=120)
    axes = drawing.subplots(1, len(panels), squeeze=False)[0]
    for ax, (key, label) in zip(axes, panels.items(), strict=True):
        for (name, run), style in zip(runs.items(), method_styles()):
            points = [p for p in run["validations"] if p[key]]  # without an error, there is none to draw on this scale
            ax.plot(
                [p["processor_minutes"] for p in points], [p[key] for p in points], label=name, ms=4, **style
            )  # fmt: skip
        ax.set_yscale("log")
        for set_formatter in (ax.yaxis.set_major_formatter, ax.yaxis.set_minor_formatter):
            set_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        ax.set_xlabel("processor time of the training [min]")
        ax.set_ylabel(label)
        ax.grid(True, which="both", color="0.9")
        ax.spines[["top", "right"]].set_visible(False)
    drawing.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=6, frameon=False)
    save(drawing, path)
