"""The figures with all methods side by side, as in the paper: whole pairs, and their hardest parts."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from m3depth.evaluation.example import Example
from m3depth.evaluation.metrics import grey_deviation
from m3depth.figures.drawing import colour_map, depth_scale, label_bar, masked_depth, note, panel_aspect, save, show
from marssim.base.images.colours import DEPTH_MAP
from marssim.base.images.depth_edges import depth_edges

PANEL = 1.9  # [in] width of one image
PART = 0.2  # side of an enlarged square, as a share of the image's shorter side
SCORED = 0.9  # share of a square that has to be scored
BOXES = ("#e6194b", "#ffe119", "#42d4f4")  # colours of the squares
ZOOM_SCALE = "depth: bright is near; each part has a scale of its own, written on its truth; grey: sky or unknown"


def qualitative_figure(examples: Sequence[Example], path: Path) -> None:
    """Write a PNG with a row a pair: left image, true depth and the depth of each method, all on one scale.

    Args:
        examples: The pairs.
        path: The file to write.
    """
    names = list(examples[0].predictions)
    columns, rows = 2 + len(names), len(examples)
    aspect = panel_aspect(examples[0].left)
    width, height = PANEL * columns + 0.4, PANEL * aspect * rows + 1.05  # [in]
    figure = Figure(figsize=(width, height), dpi=120)
    edges = {"left": 0.36 / width, "right": 1 - 0.04 / width, "top": 1 - 0.3 / height, "bottom": 0.72 / height}
    axes = figure.subplots(rows, columns, squeeze=False, gridspec_kw={**edges, "wspace": 0.03, "hspace": 0.03})
    norm = depth_scale(np.concatenate([e.truth.depth[e.scored] for e in examples]))
    depth_map = colour_map(DEPTH_MAP)
    for row, example in zip(axes, examples, strict=True):
        show(row[0], example.left)
        row[0].set_ylabel(example.title, fontsize=10)
        for ax, depth in zip(row[1:], [example.truth.depth, *(example.predictions[n].depth for n in names)]):
            show(ax, masked_depth(depth), cmap=depth_map, norm=norm)
    for ax, title in zip(axes[0], ["left image", "truth", *names], strict=True):
        ax.set_title(title, fontsize=11, fontweight="bold")
    place = figure.add_axes((0.3, 0.52 / height, 0.4, 0.14 / height))
    bar = figure.colorbar(
        matplotlib.cm.ScalarMappable(norm, depth_map), cax=place, orientation="horizontal", extend="both"
    )
    label_bar(bar, norm, "depth [m]  (grey: sky or unknown)")
    save(figure, path)


def hard_parts(example: Example) -> dict[str, tuple[int, int, int]]:
    """Return the squares of a pair with the least texture, the most depth edges and the least light.

    They do not overlap, and nine tenths of each are scored.

    Returns:
        (row, column, side) [px] by kind; a kind for which no such square is left is missing.
    """
    truth = example.truth
    scored = example.scored
    side = max(8, round(PART * min(scored.shape)))
    deviation = grey_deviation(example.left)
    edges = depth_edges(truth.disparity).astype(np.float32)
    light = example.left.astype(np.float32)
    light = light.mean(axis=2) if light.ndim == 3 else light

    def over_square(values: np.ndarray) -> np.ndarray:
        total = cv2.integral(np.asarray(values, np.float64))
        return (total[side:, side:] - total[:-side, side:] - total[side:, :-side] + total[:-side, :-side]) / side**2

    allowed = over_square(scored) >= SCORED
    parts = {}
    for name, cost in (("most edges", -edges), ("darkest", light), ("least texture", deviation)):
        if not allowed.any():
            break
        row, column = np.unravel_index(np.argmin(np.where(allowed, over_square(cost), np.inf)), allowed.shape)
        parts[name] = (int(row), int(column), side)
        allowed[max(0, row - side) : row + side, max(0, column - side) : column + side] = False
    return parts


def zoom_figure(examples: Sequence[Example], path: Path) -> None:
    """Write a PNG with each pair's hard_parts: marked in the left image, and enlarged as every method sees them.

    Each part has its own depth scale, from its nearest to its farthest true depth, which is written on it.

    Args:
        examples: The pairs.
        path: The file to write.
    """
    names = list(examples[0].predictions)
    blocks = [(example, hard_parts(example)) for example in examples]
    blocks = [(example, parts) for example, parts in blocks if parts] or [(examples[0], {})]
    columns, lines = 2 + len(names), 3 * len(blocks)
    width, height = 1.3 * (columns + 3) + 0.3, 1.3 * lines + 0.7  # [in]
    figure = Figure(figsize=(width, height), dpi=120)
    grid = figure.add_gridspec(
        lines, columns + 3, left=0.1 / width, right=1 - 0.1 / width, top=1 - 0.35 / height, bottom=0.3 / height,
        wspace=0.04, hspace=0.06,
    )  # fmt: skip
    figure.text(0.1 / width, 0.08 / height, ZOOM_SCALE, fontsize=9, color="0.3")
    for block, (example, parts) in enumerate(blocks):
        whole = figure.add_subplot(grid[3 * block : 3 * block + 3, :3])
        show(whole, example.left)
        note(whole, example.title, corner="lower left")
        for line, ((kind, (row, column, side)), colour) in enumerate(zip(parts.items(), BOXES)):
            whole.add_patch(Rectangle((column, row), side, side, fill=False, edgecolor=colour, lw=2.2))
            cut = np.s_[row : row + side, column : column + side]
            true = example.truth.depth[cut]
            norm = depth_scale(true, whole=True)
            maps = [true, *(example.predictions[name].depth[cut] for name in names)]
            for i in range(columns):
                ax = figure.add_subplot(grid[3 * block + line, 3 + i])
                if i == 0:
                    show(ax, example.left[cut])
                    note(ax, kind, corner="lower left")
                    for spine in ax.spines.values():
                        spine.set(visible=True, color=colour, linewidth=2.2)
                else:
                    show(ax, masked_depth(maps[i - 1]), cmap=colour_map(DEPTH_MAP), norm=norm)
                if i == 1:
                    note(ax, f"{norm.vmin:.3g} to {norm.vmax:.3g} m", corner="lower left")
                if block == line == 0:
                    ax.set_title(["image", "truth", *names][i], fontsize=10, fontweight="bold")
    save(figure, path)
