"""The figure of rocks found, the error of their height, and false obstacles, by height and distance."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from m3depth.evaluation.rock_scores import OBSTACLE
from m3depth.figures.drawing import METHOD_COLOURS, plain_label, save


def rocks_figure(methods: Mapping[str, Mapping[str, Any]], path: Path) -> None:
    """Write a PNG with a column a distance: share found, height error and false obstacles, a bar a method and height.

    Args:
        methods: RockCounts.result() by method. Without any rocks the figure says so.
        path: The file to write.
    """
    methods = {name: result for name, result in methods.items() if result}
    figure = Figure(figsize=(11, 7.6), layout="constrained", dpi=120)
    if not methods:
        figure.text(0.5, 0.5, "no sample records the pose of its camera: rocks have no height", ha="center")
        save(figure, path)
        return
    bins = next(iter(methods.values()))["bins"]
    lowest = min([b["height_from_m"] for m in methods.values() for b in m["bins"] if b["false"]] + [OBSTACLE])
    ranges = sorted({(b["range_from_m"], b["range_to_m"]) for b in bins})
    axes = figure.subplots(3, len(ranges), squeeze=False, sharey="row")
    for column, (near, far) in enumerate(ranges):
        by_method = {name: [b for b in m["bins"] if b["range_from_m"] == near] for name, m in methods.items()}
        first = next(iter(by_method.values()))
        labels = [_height(b) + f"\n{b['rocks']} rocks" for b in first]
        images = next(iter(methods.values()))["images"]
        _bars(axes[0, column], labels, {n: [_percent(b["found_share"]) for b in rows] for n, rows in by_method.items()})
        axes[0, column].set_title(f"{near:g} to {far:g} m away")
        axes[0, column].set_ylim(0, 105)
        errors = {n: [_centimetres(b["height_error_m"]) for b in rows] for n, rows in by_method.items()}
        _bars(axes[1, column], [_height(b) for b in first], errors)
        tall = [i for i, b in enumerate(first) if b["height_from_m"] >= lowest]
        false = {
            n: [b["false"] / images * 100 if i in tall else np.nan for i, b in enumerate(rows)]
            for n, rows in by_method.items()
        }
        _bars(axes[2, column], [_height(b) if i in tall else "" for i, b in enumerate(first)], false)
    if not any(bar.get_height() > 0 for ax in axes[2] for bar in ax.patches):
        axes[2, 0].set_ylim(0, 1)
    for ax, label in zip(
        axes[:, 0], ("rocks found [%]", "height error [cm],\nmedian of those found", "false obstacles\nin 100 images")
    ):
        ax.set_ylabel(label)
    figure.supxlabel("height of the rock or the obstacle [m]", fontsize=10)
    handles, names = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside upper center", ncols=min(len(names), 6), frameon=False)
    save(figure, path)


def _height(b: Mapping[str, Any]) -> str:
    low, high = b["height_from_m"], b["height_to_m"]
    return f"over {low:g}" if np.isinf(high) else f"{low:g}-{high:g}"


def _percent(share: float | None) -> float:
    return np.nan if share is None else 100 * share


def _centimetres(length: float | None) -> float:
    return np.nan if length is None else 100 * length


def _bars(ax: Axes, labels: list[str], values: Mapping[str, list[float]]) -> None:
    place, width = np.arange(len(labels)), 0.8 / len(values)
    for i, ((name, heights), colour) in enumerate(zip(values.items(), cycle(METHOD_COLOURS))):
        ax.bar(place + (i + 0.5) * width - 0.4, heights, width=0.92 * width, color=colour, label=plain_label(name))
    ax.set_xticks(place, labels, fontsize=8)
    ax.set_xlim(-0.5, len(labels) - 0.5)
    ax.spines[["top", "right"]].set_visible(False)
    ax.grid(True, axis="y", color="0.9")
    ax.set_axisbelow(True)
