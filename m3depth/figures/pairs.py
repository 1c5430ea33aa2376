"""The figure of one method's disparity and normals on a few pairs, with their errors and its confidence."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from m3depth.evaluation.example import Example
from m3depth.figures.drawing import colour_map, label_bar, normal_image, note, panel_aspect, save, show
from m3depth.figures.panels import predicted_normal_image, show_disparity_error
from marssim.base.images.colours import DISPARITY_MAP, NORMAL_TITLE

PANEL = 1.7  # [in] width of one image
LARGEST_ERROR = 4.0  # [px] error where the colour ends
LEGEND = (
    "disparity: bright is near; each pair has a scale of its own, which is written on its truth\n"
    "grey: sky or unknown; in the error: not scored"
)
COLUMNS = ("left", "true disparity", "predicted disparity", "error", "confidence")
NORMAL_COLUMNS = ("true normals", "predicted normals")


def pairs_figure(examples: Sequence[Example], path: Path) -> np.ndarray:
    """Write a PNG with a row a pair, as the first method sees it.

    The true and the predicted disparity of a pair share a scale, that of its scored pixels. Its ends are written on the
    true one, in pixels and in metres of depth. Grey is sky or unknown; in the errors it is what is not scored. If the
    method has no normals, the columns of normals are left out.

    Args:
        examples: The pairs.
        path: The file to write.

    Returns:
        (H, W, 3) uint8 RGB, the picture.
    """
    rows = len(examples)
    methods = [next(iter(example.predictions.values())) for example in examples]
    has_normals = any(prediction.normal is not None for prediction in methods)
    columns = COLUMNS + NORMAL_COLUMNS if has_normals else COLUMNS
    aspect = panel_aspect(examples[0].left)
    width, height = PANEL * len(columns) + 0.4, PANEL * aspect * rows + 1.0  # [in]
    figure = Figure(figsize=(width, height), dpi=120)
    edges = {"left": 0.36 / width, "right": 1 - 0.04 / width, "top": 1 - 0.3 / height, "bottom": 0.7 / height}
    axes = figure.subplots(rows, len(columns), squeeze=False, gridspec_kw={**edges, "wspace": 0.03, "hspace": 0.03})
    legend = f"{LEGEND}\n{NORMAL_TITLE}" if has_normals else LEGEND
    errors, shares = Normalize(0, LARGEST_ERROR), Normalize(0, 1)
    for row, example, prediction in zip(axes, examples, methods, strict=True):
        truth = example.truth
        scored = example.scored
        norm = Normalize(*np.percentile(truth.disparity[scored], [1, 99])) if scored.any() else Normalize(0, 1)
        show(row[0], example.left)
        row[0].set_ylabel(example.title, fontsize=10)
        for ax, disparity in ((row[1], truth.disparity), (row[2], prediction.disparity)):
            show(ax, np.where(disparity > 0, disparity, np.nan), cmap=colour_map(DISPARITY_MAP), norm=norm)
        note(row[1], scale_text(norm, truth.rig.fb))
        error_image = show_disparity_error(row[3], prediction.disparity, truth.disparity, scored, errors)
        share_image = show(row[4], prediction.confidence, cmap=colour_map("cividis"), norm=shares)
        if has_normals:
            show(row[5], normal_image(truth.normal))
        if prediction.normal is not None:
            show(row[6], predicted_normal_image(prediction.normal, prediction.depth))
    for ax, name in zip(axes[0], columns, strict=True):
        ax.set_title(name, fontsize=10)
    figure.text(0.36 / width, 0.46 / height, legend, fontsize=8, va="top")
    for column, image, label in ((3, error_image, "error [px]"), (4, share_image, "confidence")):
        box = axes[-1, column].get_position()
        at = (box.x0 + 0.1 * box.width, 0.5 / height, 0.8 * box.width, 0.1 / height)
        bar = figure.colorbar(image, cax=figure.add_axes(at), orientation="horizontal")
        label_bar(bar, image.norm, label)
    return save(figure, path)


def scale_text(norm: Normalize, fb: float) -> str:
    """Return the ends of a scale of disparity, in pixels and in metres of depth.

    Args:
        norm: The scale of disparity [px].
        fb: Focal length x baseline [px m].
    """
    low, high = float(norm.vmin or 0), float(norm.vmax or 0)
    farthest = f"{fb / low:.3g}" if low > 0 else "inf"
    return f"{low:.3g} to {high:.3g} px\n{farthest} to {fb / high:.3g} m"
