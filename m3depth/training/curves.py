"""The curves of a training run as a picture: loss and validation over steps, drawn from the run's log."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator

from m3depth.figures.drawing import METHOD_COLOURS, save
from m3depth.training.log import records

CURVES = "curves.png"  # name of the picture in a run's folder
LOSS, AVERAGED, CURRENT = METHOD_COLOURS[:3]
VALIDATED = (("epe", "EPE [px]"), ("abs_rel", "Abs Rel of depth"), ("normal", "error of the normals [deg]"))
PANEL = (5.2, 3.4)  # width and height of a panel [inch]
SMOOTHED = 25  # records of the loss in a running mean
LEAST_SMOOTHED = 4 * SMOOTHED  # records from which the mean is drawn
LOG_RANGE = 3.0  # ratio of values from which an axis is logarithmic


def save_curves(out: Path) -> Path | None:
    """Draw RUN/curves.png from RUN/log.jsonl: the training loss, and EPE, Abs Rel and normals on the val split.

    A panel without numbers is left out: those of the validation without pairs in the val split, that of the normals
    where the dataset has none.

    Args:
        out: Folder of the run.

    Returns:
        The picture; None, and no file, if nothing is logged yet.

    Raises:
        OSError: The picture cannot be written.
    """
    steps, loss = series(records(out, "train"), "loss")
    averaged, current = records(out, "val"), records(out, "val_raw")
    panels = [(key, label) for key, label in VALIDATED if len(series(averaged, key)[0])]
    count = len(panels) + (len(steps) > 0)
    if not count:
        return None
    columns, rows = min(count, 2), -(-count // 2)
    figure = Figure(figsize=(PANEL[0] * columns, PANEL[1] * rows), dpi=110, layout="constrained")
    axes = list(figure.subplots(rows, columns, squeeze=False).flat)
    for unused in axes[count:]:
        unused.remove()
    if len(steps):
        draw_loss(axes.pop(0), steps, loss)
    for ax, (key, label) in zip(axes, panels):
        draw_validation(ax, series(averaged, key), series(current, key), label)
    save(figure, out / CURVES)
    return out / CURVES


def series(log: Iterable[dict[str, Any]], key: str) -> tuple[np.ndarray, np.ndarray]:
    """Return steps and values of a key in records; null values, which are not finite, are left out.

    Args:
        log: Records of one kind.
        key: Name of the value.
    """
    points = [(record["step"], record[key]) for record in log if record.get(key) is not None]
    steps, values = np.array(points, float).reshape(-1, 2).T
    return steps, values


def draw_loss(ax: Axes, steps: np.ndarray, loss: np.ndarray) -> None:
    """Draw the loss of single batches and, once there are enough, its running mean.

    Args:
        ax: The axes.
        steps: (N,) steps.
        loss: (N,) losses.
    """
    enough = len(loss) >= LEAST_SMOOTHED
    line = {"lw": 1, "alpha": 0.35} if enough else {"lw": 1, "marker": "o", "ms": 4}
    ax.plot(steps, loss, color=LOSS, label="one batch", **line)
    if enough:
        mean = np.convolve(loss, np.full(SMOOTHED, 1 / SMOOTHED), "valid")
        ax.plot(steps[SMOOTHED // 2 :][: len(mean)], mean, color=LOSS, lw=2, label=f"mean of {SMOOTHED} batches")
    label_axes(ax, loss, "training loss (weighted sum)")


def draw_validation(
    ax: Axes, averaged: tuple[np.ndarray, np.ndarray], current: tuple[np.ndarray, np.ndarray], label: str
) -> None:
    """Draw an error on the val split, of the averaged weights (the saved ones) and of the current ones.

    Args:
        ax: The axes.
        averaged: Steps and errors of the averaged weights.
        current: Steps and errors of the current weights.
        label: The error with its unit.
    """
    if len(current[0]):
        ax.plot(*current, color=CURRENT, lw=1, marker=".", label="current weights")
    ax.plot(*averaged, color=AVERAGED, lw=2, marker="o", ms=4, label="averaged weights (saved)")
    label_axes(ax, np.concatenate([current[1], averaged[1]]), f"{label}, val split")


def label_axes(ax: Axes, values: np.ndarray, label: str) -> None:
    """Name the axes. The vertical one is logarithmic where the largest value is over LOG_RANGE times the least.

    Args:
        ax: The axes.
        values: All values that are drawn.
        label: The values with their unit.
    """
    if 0 < LOG_RANGE * values.min() < values.max():
        ax.set_yscale("log")
        ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        ax.yaxis.set_minor_formatter(FuncFormatter(lambda value, _: f"{value:g}" if f"{value:e}"[0] in "25" else ""))
    ax.xaxis.set_major_locator(MaxNLocator(6, integer=True))
    ax.set_xlabel("optimizer step")
    ax.set_ylabel(label)
    ax.set_xlim(left=0)
    ax.grid(True, which="both", alpha=0.25)
    ax.legend(fontsize=8)
