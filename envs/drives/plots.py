"""Success of drives against rock abundance, and against the error of the depth on the way."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from envs.drives.episodes import Cell, EpisodeRecord
from envs.drives.metrics import effective_drives, wilson_interval
from m3depth.figures.drawing import legend_labels, method_styles, plain_label, save


def plot_success(
    path: Path,
    results: Sequence[dict[str, Any]],
    records: Sequence[EpisodeRecord],
    test_set: Mapping[str, float] | None = None,
) -> None:
    """Plot success against k (left, slopes pooled) and against Abs Rel on the way (right, a point for each cell).

    Of drives under conditions, the left plot shows success by condition instead, with k and slopes pooled.

    The right plot is left out if all was driven by true depth. Bars are 95 % Wilson intervals. Where slopes are pooled,
    the drives count as many as effective_drives says, as courses of one number have their rocks in common.

    Args:
        path: File of the picture.
        results: Rows of results.json.
        records: The records of their drives.
        test_set: Abs Rel of perceptions on their test set, as dotted lines in the right plot.
    """
    erring = any(r["abs_rel"] is not None for r in results)
    figure = Figure(figsize=(9.6 if erring else 5.0, 4.0), dpi=110, layout="constrained")
    by_k, *others = figure.subplots(1, 1 + erring, sharey=True, squeeze=False)[0]
    groups = list(dict.fromkeys((r["driver"], r["perception"]) for r in results))
    conditions = list(dict.fromkeys(r["cell"].get("condition") for r in results))
    by_condition = conditions != [None]
    labels = legend_labels([", ".join(group) for group in groups])
    for n, (group, label, style) in enumerate(zip(groups, labels, method_styles(), strict=False)):
        rows = [r for r in results if (r["driver"], r["perception"]) == group]
        drives = [record for record in records if (record.driver, record.perception) == group]
        aside = n - (len(groups) - 1) / 2
        if by_condition:
            pooled = pool_by(rows, drives, "condition", conditions)
            at = [conditions.index(condition) + min(0.12, 0.8 / len(groups)) * aside for condition in pooled]
        else:
            pooled = pool_by(rows, drives, "k", sorted({r["cell"]["k"] for r in rows}, key=lambda k: k or 0.0))
            at = [(k or 0.0) + 0.0008 * aside for k in pooled]
        _bars(by_k, at, list(pooled.values()), style, label, line=not by_condition)
        for by_error in others:
            scored = [r for r in rows if r["abs_rel"] is not None]
            points = [(r["success_rate"], r["episodes"]) for r in scored]
            _bars(by_error, [r["abs_rel"] for r in scored], points, style, label, line=False)
            if scored and test_set and group[1] in test_set:
                by_error.axvline(
                    test_set[group[1]], color=style["color"], ls=":", label=plain_label(f"{group[1]}, test set")
                )
    if by_condition:
        by_k.set(title="by condition")
        by_k.set_xticks(
            range(len(conditions)), [plain_label(str(c or "none")) for c in conditions], rotation=60, ha="right"
        )
    else:
        by_k.set(xlabel="rock abundance k", title="by rock abundance, slopes pooled")
        driven = sorted({r["cell"]["k"] for r in results}, key=lambda k: k or 0.0)
        by_k.set_xticks([k or 0.0 for k in driven], ["the preset's" if k is None else f"{k:g}" for k in driven])
        by_k.set_xlim((driven[0] or 0.0) - 0.01, (driven[-1] or 0.0) + 0.01)
    by_k.set(ylabel="success [%]", ylim=(-4, 104))
    by_k.grid(alpha=0.3)
    for by_error in others:
        by_error.set(
            xlabel="Abs Rel of the depth on the way, up to 15 m", title="by depth error, a point for each cell"
        )
        by_error.locator_params(axis="x", nbins=6)
        by_error.grid(alpha=0.3)
    named = [axes.get_legend_handles_labels() for axes in (*others, by_k)]  # by_k last: its handles, with a line, win
    handles = {label: handle for pair in named for handle, label in zip(*pair)}
    for axes in (by_k, *others):
        axes.title.set_fontsize(9)
    figure.legend(
        handles.values(), handles.keys(), loc="outside lower center", ncols=2 if erring else 1, fontsize=8,
        title="driver, perception; bars are 95 % intervals", title_fontsize=8,
    )  # fmt: skip
    save(figure, path)


def pool_by(
    rows: Sequence[dict[str, Any]], records: Sequence[EpisodeRecord], key: str, values: Sequence[Any]
) -> dict[Any, tuple[float, float]]:
    """Return for each value of a cell the share of arrivals, and as how many independent drives they count.

    Args:
        rows: Rows of results.json of one driver and perception.
        records: The records of their drives.
        key: Key of the cell: "k" or "condition".
        values: The values, in order. Those without a drive are left out.
    """
    out: dict[Any, tuple[float, float]] = {}
    for value in values:
        cells = {Cell(**r["cell"]).name for r in rows if r["cell"].get(key) == value}
        drives = [record for record in records if record.cell in cells]
        if drives:
            arrived = np.array([float(record.outcome == "goal") for record in drives])
            out[value] = (float(arrived.mean()), effective_drives(arrived, [record.episode for record in drives]))
    return out


def _bars(
    axes: Any, x: list[float], points: list[tuple[float, float]], style: dict[str, Any], label: str, line: bool
) -> None:
    """Plot points (share of arrivals, number of trials) with their intervals."""
    if not points:
        return
    rate = np.array([100 * share for share, _ in points])
    ends = 100 * np.array([wilson_interval(share * trials, trials) for share, trials in points]).T
    error = np.abs(np.vstack([rate - ends[0], ends[1] - rate]))
    axes.errorbar(x, rate, error, label=label, ls="-" if line else "none", ms=4, lw=1.3, capsize=2, **style)
