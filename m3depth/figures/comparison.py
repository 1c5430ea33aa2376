"""The figure that compares methods: pairs, their truth, the predictions and their errors."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from m3depth.evaluation.example import Example
from m3depth.evaluation.metrics import angle_between, capped_depth
from m3depth.figures.drawing import (
    UNSCORED,
    colour_map,
    depth_scale,
    label_bar,
    masked_depth,
    normal_image,
    note,
    panel_aspect,
    save,
    show,
)
from m3depth.figures.panels import predicted_normal_image
from marssim.base.command.wording import counted
from marssim.base.images.colours import DEPTH_MAP, NORMAL_TITLE

PANEL = 2.1  # [in] width of one image
ERROR_MAP, ANGLE_MAP = "magma", "inferno"  # matplotlib's names of the colours of depth errors and of angles
ERROR_LIMIT = 10.0  # [%] relative depth error where the colour ends
ANGLE_LIMIT = 45.0  # [deg] angle between normals where the colour ends


def comparison_figure(examples: Sequence[Example], path: Path, most: int | None = None) -> None:
    """Write a PNG with two rows a pair, depth above and normals below: images, truth, each method and its error.

    Each panel has its name in a corner. All methods share the scales: depth is logarithmic, its error in percent of the
    true depth, angles in degrees.

    Args:
        examples: The pairs.
        path: The file to write.
        most: Number of methods that are drawn, the first ones; the figure says how many others there are. None: all.
    """
    names = list(examples[0].predictions)[:most]
    others = len(examples[0].predictions) - len(names)
    columns = 2 + 2 * len(names)
    rows = 2 * len(examples)
    # A figure of one method is too narrow for labels of one line.
    gap, extra = ("  ", 0.0) if len(names) > 1 else ("\n", 0.15)
    width, height = PANEL * columns + 0.5, PANEL * rows * panel_aspect(examples[0].left) + 1.4 + extra  # [in]
    figure = Figure(figsize=(width, height), dpi=110)
    grid = {
        "left": 0.48 / width,
        "right": 1 - 0.05 / width,
        "top": 1 - 0.32 / height,
        "bottom": (1.05 + extra) / height,
    }
    axes = figure.subplots(rows, columns, squeeze=False, gridspec_kw={**grid, "wspace": 0.03, "hspace": 0.03})
    depths = np.concatenate([e.truth.depth[e.scored] for e in examples])
    depth_norm = depth_scale(depths)
    for pair, example in enumerate(examples):
        upper, lower = axes[2 * pair], axes[2 * pair + 1]
        truth = example.truth
        show(upper[0], example.left)
        show(lower[0], example.right)
        show(upper[1], masked_depth(truth.depth), cmap=colour_map(DEPTH_MAP), norm=depth_norm)
        show(lower[1], normal_image(truth.normal))
        upper[0].set_ylabel(example.title, fontsize=10)
        for ax, text in (
            (upper[0], "left image"), (lower[0], "right image"), (upper[1], "true depth"), (lower[1], "true normals"),
        ):  # fmt: skip
            note(ax, text)
        for i, name in enumerate(names):
            columns_of_method = slice(2 + 2 * i, 4 + 2 * i)
            _draw_depth(upper[columns_of_method], example, name, depth_norm)
            _draw_normals(lower[columns_of_method], example, name)
    titles = ["images", "truth", *(t for name in names for t in (name, f"{name}: error"))]
    for ax, title in zip(axes[0], titles, strict=True):
        ax.set_title(title, fontsize=12, fontweight="bold")
    if others:
        figure.text(0.05 / width, 0.05 / height, f"and {counted(others, 'method')} more", fontsize=9, color="0.3")
    figure.text(1 - 0.05 / width, 0.05 / height, NORMAL_TITLE, fontsize=9, color="0.3", ha="right")
    _draw_bars(figure, depth_norm, gap, extra)
    save(figure, path)


def _draw_depth(axes: Sequence[Axes], example: Example, name: str, depth_norm: Normalize) -> None:
    """Draw a method's depth, and its error in percent of the true depth, beside each other."""
    truth, depth = example.truth, example.predictions[name].depth
    scored = example.scored
    show(axes[0], masked_depth(depth), cmap=colour_map(DEPTH_MAP), norm=depth_norm)
    relative = np.zeros(scored.shape)
    relative[scored] = 100 * np.abs(capped_depth(depth) / capped_depth(truth.depth) - 1)[scored]
    show(axes[1], np.ma.masked_array(relative, ~scored), cmap=colour_map(ERROR_MAP), norm=Normalize(0, ERROR_LIMIT))
    note(axes[0], "depth")
    note(axes[1], "depth error" + (f": mean {relative[scored].mean():.1f} %" if scored.any() else ""))


def _draw_normals(axes: Sequence[Axes], example: Example, name: str) -> None:
    """Draw a method's normals, and their angles to the true ones, beside each other; grey for a method without any."""
    truth, prediction = example.truth, example.predictions[name]
    scored = example.scored
    if prediction.normal is None:
        for ax in axes:
            show(ax, np.full((*scored.shape, 3), float(UNSCORED)))
            note(ax, "no normals")
        return
    oriented = scored & (np.linalg.norm(truth.normal, axis=-1) > 0.5)
    angle = np.zeros(scored.shape)
    angle[oriented] = angle_between(prediction.normal[oriented], truth.normal[oriented])
    show(axes[0], predicted_normal_image(prediction.normal, prediction.depth))
    show(axes[1], np.ma.masked_array(angle, ~oriented), cmap=colour_map(ANGLE_MAP), norm=Normalize(0, ANGLE_LIMIT))
    note(axes[0], "normals")
    note(axes[1], "angle error" + (f": mean {angle[oriented].mean():.1f}°" if oriented.any() else ""))


def _draw_bars(figure: Figure, depth_norm: Normalize, gap: str, extra: float) -> None:
    """Draw the three colour bars side by side below the images.

    Args:
        figure: The figure.
        depth_norm: The scale of depth.
        gap: What separates the two parts of a label: spaces, or a line break in a narrow figure.
        extra: Height that line breaks need [in].
    """
    height = figure.get_figheight()
    bars = (
        (depth_norm, DEPTH_MAP, f"depth [m]{gap}(grey: sky or unknown)", "both"),
        (Normalize(0, ERROR_LIMIT), ERROR_MAP, f"depth error [% of the true depth]{gap}(grey: not scored)", "max"),
        (Normalize(0, ANGLE_LIMIT), ANGLE_MAP, "angle between normals [deg]", "max"),
    )
    for i, (norm, colours, label, extend) in enumerate(bars):
        place = figure.add_axes(((i + 0.12) / 3, (0.72 + extra) / height, 0.76 / 3, 0.16 / height))
        mappable = matplotlib.cm.ScalarMappable(norm, colour_map(colours))
        bar = figure.colorbar(mappable, cax=place, orientation="horizontal", extend=extend)
        label_bar(bar, norm, label)
