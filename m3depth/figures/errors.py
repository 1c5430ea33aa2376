"""The figures of errors by true depth and by confidence."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from m3depth.figures.drawing import method_styles, plain_label, save

# Errors of interval_figure, by their names in results.
ERRORS = {
    "mae": "mean absolute error [m]",
    "rmse": "mean squared error [m²]",
    "bad1": "disparities off by more than 1 px [%]",
}
MANY = 12  # lines of a legend; more of them are written small. With more methods, the figure is larger instead.


def interval_figure(
    results: dict[str, dict[str, Any]], path: Path, fb: float | None = None, untrained: Collection[str] = ()
) -> None:
    """Write a PNG of the errors by true depth, in the 15 intervals of the paper's figure.

    Args:
        results: Scores.result() by method.
        path: The file to write.
        fb: Focal length times baseline [px m] of the rig, for the error that a constant error of disparity gives. None:
            it is not drawn.
        untrained: Methods whose lines are dashed; a note below the panels says that they were not trained here. With
            more than MANY methods, they get a second row of panels, beside the first method.
    """
    many = len(results) > MANY
    styles = dict(zip(results, method_styles()))
    trained = [name for name in results if name not in untrained]
    groups = [list(results)]
    if many and 0 < len(trained) < len(results):  # the first method is in both, to compare with
        groups = [trained, [trained[0], *(name for name in results if name in untrained)]]
    figure = Figure(
        figsize=(13, 6.4 * len(groups) if len(groups) > 1 else 7.6) if many else (11, 4.6),
        layout="constrained",
        dpi=120,
    )
    for part, names in zip(figure.subfigures(len(groups), 1, squeeze=False)[:, 0], groups, strict=True):
        panels = part.subplots(1, 3)
        for ax, key in zip(panels, ERRORS, strict=True):
            for name in names:
                rows = [r for r in results[name]["intervals"] if r["pixels"]]
                centres = [(r["from_m"] + r["to_m"]) / 2 for r in rows]
                values = [r["pooled"][key] ** (2 if key == "rmse" else 1) * (100 if key == "bad1" else 1) for r in rows]
                ax.plot(centres, values, ms=5, lw=1.3 if many else 1.8, ls="--" if name in untrained else "-",
                        label=plain_label(name), **styles[name])  # fmt: skip
            _lay_out_intervals(ax, key, fb, next(iter(results.values()))["intervals"])
        handles, labels = panels[0].get_legend_handles_labels()
        size = 10 if many or len(labels) <= MANY else 8
        columns = min(len(labels), 6)
        part.legend(handles, labels, loc="outside upper center", ncols=columns, frameon=False, fontsize=size)
    remark = "bars: share of the scored pixels" + "; dashed: not trained here" * bool(untrained)
    figure.supxlabel(remark, fontsize=8, color="0.45")
    save(figure, path)


def _lay_out_intervals(ax: Axes, key: str, fb: float | None, intervals: Sequence[dict[str, Any]]) -> None:
    """Add axes, errors of constant disparity and the bars of the pixels' shares to a panel of interval_figure."""
    if fb and key == "mae":
        z = np.linspace(0.8, 15, 100)
        for pixels in (0.25, 1.0):
            ax.plot(z, z**2 * pixels / fb, color="0.6", lw=1, ls=":" if pixels < 1 else "--", zorder=1,
                    label=f"{pixels:g} px of disparity")  # fmt: skip
    if key == "bad1":
        ax.set_ylim(bottom=0)
    else:
        ax.set_yscale("log")
        ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.set_ylabel(ERRORS[key])
    ax.set_xlim(0, 15)
    ax.set_xticks(range(0, 16, 3))
    ax.set_xlabel("true depth [m]")
    ax.grid(True, which="major", color="0.9")
    ax.spines[["top", "right"]].set_visible(False)
    shares = ax.twinx()
    total = max(1, sum(r["pixels"] for r in intervals))
    shares.bar([(r["from_m"] + r["to_m"]) / 2 for r in intervals], [r["pixels"] / total for r in intervals],
               width=0.9, color="0.93", zorder=0)  # fmt: skip
    shares.set_ylim(0, 2.5 * max(max(r["pixels"] for r in intervals) / total, 1e-6))
    shares.set_axis_off()
    ax.set_zorder(shares.get_zorder() + 1)
    ax.patch.set_visible(False)


def distribution_figure(results: dict[str, dict[str, Any]], path: Path) -> None:
    """Write a PNG of the frequency of absolute errors by true depth, a panel a method (the paper's cloud of points).

    The line is the mean of each depth interval.

    Args:
        results: Scores.result() by method.
        path: The file to write.
    """
    columns = min(4, len(results))
    rows = -(-len(results) // columns)
    figure = Figure(figsize=(3.4 * columns + 0.9, 3.1 * rows), layout="constrained", dpi=120)
    panels = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    shown = None
    for ax, (name, result) in zip(panels.flat, results.items()):
        counts = np.array(result["error_map"]["counts"], float)
        depths = np.arange(counts.shape[1] + 1) * result["error_map"]["depth_step_m"]
        low, high = (result["error_map"][f"error_{end}_m"] for end in ("from", "to"))
        errors = np.geomspace(low, high, counts.shape[0] + 1)
        share = np.ma.masked_equal(100 * counts / max(counts.sum(), 1), 0)
        shown = ax.pcolormesh(depths, errors, share, norm=LogNorm(1e-4, 1), cmap="viridis", rasterized=True)
        intervals = [r for r in result["intervals"] if r["pixels"]]
        middle = [(r["from_m"] + r["to_m"]) / 2 for r in intervals]
        ax.plot(middle, [r["pooled"]["mae"] for r in intervals], color="#d55e00", lw=1.8, marker="o", ms=3)
        pooled = result["depth"]["all"]["pooled"]
        if pooled:
            spread = np.sqrt(max(pooled["rmse"] ** 2 - pooled["mae"] ** 2, 0))
            ax.set_title(f"{name}: {pooled['mae']:.3f} ± {spread:.3f} m", fontsize=10)
        ax.set_yscale("log")
        ax.set_xlim(0, depths[-1])
        ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    for ax in panels.flat[len(results) :]:
        ax.set_axis_off()
    figure.supxlabel("true depth [m]", fontsize=10)
    figure.supylabel("absolute error [m]", fontsize=10)
    if shown is not None:
        figure.colorbar(shown, ax=panels, label="share of the scored pixels [%]", extend="both")
    save(figure, path)


def sparsification_figure(results: dict[str, dict[str, Any]], path: Path) -> None:
    """Write a PNG of the error that is left as the least confident pixels are dropped; the oracle's is dashed.

    Args:
        results: Scores.result() by method; methods of constant confidence have no curve.
        path: The file to write.
    """
    figure = Figure(figsize=(9.5, 4.2), layout="constrained", dpi=120)
    panels = figure.subplots(1, 2)
    for ax, key, label, unit in zip(panels, ("epe", "bad1"), ("mean error left [px]", "over 1 px [%]"), (1, 100)):
        for (name, result), style in zip(results.items(), method_styles()):
            curve = result["sparsification"]
            if not curve:
                continue
            dropped = 100 * np.array(curve["dropped"])
            ax.plot(dropped, unit * np.array(curve[key]), ms=4, lw=1.8, label=plain_label(name), **style)
            ax.plot(dropped, unit * np.array(curve[f"oracle_{key}"]), color=style["color"], lw=1.2, ls="--")
        ax.set_xlabel("least confident pixels dropped [%]")
        ax.set_ylabel(label)
        ax.set_xlim(0, 95)
        ax.set_ylim(bottom=0)
        ax.grid(True, color="0.9")
        ax.spines[["top", "right"]].set_visible(False)
    handles, labels = panels[0].get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside upper center", ncols=min(len(labels), 6), frameon=False)
    figure.supxlabel("dashed: the oracle, which drops the worst pixels first", fontsize=8, color="0.45")
    save(figure, path)
