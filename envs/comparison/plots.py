"""Plots of a comparison on a suite: the scores by condition, and the scores over the errors of the depth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter
from matplotlib.transforms import Bbox

from envs.comparison.depth_metrics import FEWEST, METRICS, SCORES, correlation_in_words, correlation_of
from m3depth.evaluation.bootstrap import FEWEST_CLUSTERS
from m3depth.figures.drawing import legend_labels, method_styles, plain_label, save

SPREAD = 0.7  # of the height of a condition, over which its methods lie
LABELLED = 10  # dots of a panel that are labelled with their condition, if there is room: those of the lowest scores
LABEL_HEIGHTS = (-2, 3, -7)  # [pt] of a label over its dot, in the order in which they are tried
DOT_SIZE = 5  # [pt] width of a dot
LOG_TICKS = (1, 2, 5)  # of each decade


def plot_comparison(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Plot success and SPL by condition, and what they are less those of the first method, one colour a method.

    Bars are 95 % intervals: in the two panels on the right, those of the paired differences. There is none of SPL over
    fewer than FEWEST_CLUSTERS courses.

    Args:
        path: File of the picture.
        rows: Of envs.comparison.report.compare_methods.
    """
    conditions = list(dict.fromkeys(row["condition"] for row in rows))
    methods = list(dict.fromkeys(row["method"] for row in rows))
    first = methods[0]
    height = max(2.5, 0.09 * len(conditions) * (len(methods) + 2))
    figure = Figure(figsize=(13.0, height + 1.2), dpi=110, layout="constrained")
    panels = figure.subplots(1, 2 if len(methods) == 1 else 4, sharey=True)
    styles = dict(zip(methods, method_styles(), strict=False))
    named = dict(zip(methods, legend_labels(methods), strict=True))
    for n, method in enumerate(methods):
        of_method = [row for row in rows if row["method"] == method]
        aside = SPREAD * ((n + 0.5) / len(methods) - 0.5)
        at = np.arange(len(of_method)) + aside
        values = [
            ([100 * row["success_rate"] for row in of_method], [row["success_interval"] for row in of_method], 100),
            ([row["spl"] for row in of_method], [row["spl_interval"] for row in of_method], 1),
        ]
        if method != first:
            less = [row["less"] for row in of_method]
            values += [
                ([100 * each["difference"] for each in less], [each["interval"] for each in less], 100),
                ([each["spl_difference"] for each in less], [each["spl_interval"] for each in less], 1),
            ]
        for axes, (middle, ends, scale) in zip(panels, values, strict=False):
            low, high = scale * np.array([each or (np.nan, np.nan) for each in ends]).T
            error = np.abs(np.vstack([middle - low, high - middle]))
            axes.errorbar(
                middle, at, xerr=error, ls="none", ms=3.5, lw=1.2, capsize=1.5, label=named[method], **styles[method],
            )  # fmt: skip
    panels[0].set(xlabel="success [%]", xlim=(-4, 104))
    panels[1].set(xlabel="SPL", xlim=(-0.04, 1.04))
    if len(methods) > 1:
        panels[2].set(xlabel="success, difference to first [points]")
        panels[3].set(xlabel="SPL, difference to first")
    for axes in panels:
        axes.grid(axis="x", alpha=0.3)
        for n in range(0, len(conditions), 2):
            axes.axhspan(n - 0.5, n + 0.5, color="#000", alpha=0.045, lw=0)
    for axes in panels[2:]:
        axes.axvline(0, color=styles[first]["color"], lw=1)  # the first method
    panels[0].set_yticks(range(len(conditions)), [plain_label(name.replace("_", " ")) for name in conditions])
    panels[0].set_ylim(len(conditions) - 0.5, -0.5)
    handles, labels = panels[0].get_legend_handles_labels()
    few = any(row["courses"] < FEWEST_CLUSTERS for row in rows)
    short = f"; none of SPL over fewer than {FEWEST_CLUSTERS} courses" if few else ""
    figure.legend(
        handles, [f"{labels[0]} (first)", *labels[1:]], loc="outside upper center", ncols=min(len(labels), 3),
        fontsize=8, title=f"bars are 95 % intervals{short}", title_fontsize=8,
    )  # fmt: skip
    save(figure, path)


def plot_depth_metrics(
    path: Path, dots: Sequence[Mapping[str, Any]], correlations: Sequence[Mapping[str, Any]]
) -> None:
    """Plot success and SPL over each metric of the depth on the way, a dot for each condition and method.

    Metrics without a row of correlations are left out, such as one that is 0 nearly everywhere, or within all methods
    but one.

    Args:
        path: File of the picture.
        dots: Of envs.comparison.depth_metrics.condition_dots, some of them with metrics.
        correlations: Of envs.comparison.depth_metrics.correlate, as only_with_intervals returns them; not empty.
    """
    shown = [name for name in METRICS if any(row["metric"] == name for row in correlations)]
    methods = list(dict.fromkeys(dot["method"] for dot in dots))
    styles = dict(zip(methods, method_styles(), strict=False))
    named = dict(zip(methods, legend_labels(methods), strict=True))
    figure = Figure(figsize=(4.4 * len(shown) + 0.6, 7.4), dpi=110, layout="constrained")
    panels = figure.subplots(2, len(shown), sharex="col", sharey="row", squeeze=False)
    for row, (score, (words, scale)) in zip(panels, SCORES.items(), strict=True):
        for axes, metric in zip(row, shown, strict=True):
            with_metric = [dot for dot in dots if dot[metric] is not None]
            for method, style in styles.items():
                if of_method := [dot for dot in with_metric if dot["method"] == method]:
                    x, y = (np.array([dot[name] for dot in of_method]) for name in (metric, score))
                    axes.plot(x, scale * y, ls="none", ms=DOT_SIZE, alpha=0.8, label=named[method], **style)
            axes.set_title(_correlation_in_words(correlation_of(correlations, score, metric)), fontsize=8)
            axes.grid(alpha=0.3)
            if METRICS[metric].logarithmic and min(dot[metric] for dot in with_metric) > 0:
                axes.set_xscale("log")
                axes.xaxis.set_major_locator(LogLocator(subs=LOG_TICKS))
                axes.xaxis.set_major_formatter("{x:g}")
                axes.xaxis.set_minor_formatter(NullFormatter())
        row[0].set_ylabel(words)
    for axes, metric in zip(panels[-1], shown, strict=True):
        axes.set_xlabel(METRICS[metric].words)
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="outside upper center", ncols=min(len(labels), 3), fontsize=8,
        title="a dot for each condition and method", title_fontsize=8,
    )  # fmt: skip
    figure.draw_without_rendering()  # places the panels, and with them the labels
    for row, (score, (_, scale)) in zip(panels, SCORES.items(), strict=True):
        for axes, metric in zip(row, shown, strict=True):
            _label_lowest(axes, [
                (plain_label(dot["condition"].replace("_", " ")), styles[dot["method"]]["color"], dot[metric],
                 scale * dot[score])
                for dot in dots if dot[metric] is not None
            ])  # fmt: skip
    save(figure, path)


def _label_lowest(axes: Axes, dots: Sequence[tuple[str, str, float, float]]) -> None:
    """Write the words of the LABELLED lowest dots (words, colour, x, y) beside them, where they cover nothing else.

    A label that would be nearer to another dot than to its own is left out too.
    """
    places = axes.transData.transform([(x, y) for _, _, x, y in dots])
    half = DOT_SIZE / 2 * axes.figure.dpi / 72  # [px]
    circles = [Bbox([place - half, place + half]) for place in places]
    taken = list(circles)
    for n in sorted(range(len(dots)), key=lambda n: dots[n][3])[:LABELLED]:
        words, colour, x, y = dots[n]
        for right, up in product((True, False), LABEL_HEIGHTS):
            label = axes.annotate(
                words, (x, y), (5 if right else -5, up), ha="left" if right else "right", fontsize=6.5,
                textcoords="offset points", color=colour,
            )  # fmt: skip
            box = label.get_window_extent()
            inside = box.x0 >= axes.bbox.x0 and box.x1 <= axes.bbox.x1 and box.y0 >= axes.bbox.y0
            inside &= box.y1 <= axes.bbox.y1
            distances = [_distance(box, place) for place in places]
            if inside and not any(map(box.overlaps, taken)) and distances[n] <= min(distances):
                taken.append(box)
                break
            label.remove()


def _distance(box: Bbox, place: np.ndarray) -> float:
    """Return the distance of a place from a box, in their unit; 0 inside."""
    return float(np.hypot(*np.maximum(np.maximum(box.min - place, place - box.max), 0)))


def _correlation_in_words(row: Mapping[str, Any] | None) -> str:
    if row is None:
        return f"no correlation: fewer than {FEWEST} dots that differ"
    if row["spearman"] is row["pearson"] is None:
        return "no correlation: it would have no interval"
    return "\n".join(f"{kind.capitalize()} {correlation_in_words(row, kind)}" for kind in ("spearman", "pearson"))
