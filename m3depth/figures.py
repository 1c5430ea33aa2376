"""Figures of depth and normals. Drawn with matplotlib's object interface: no display, no global state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path
from typing import Any

import cv2
import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import Colormap, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from m3depth.metrics import StereoTruth, angle_between, capped_depth, pixel_kinds
from m3depth.prediction import Prediction
from marssim.contact_sheet import normal_colours

DEPTH_TICKS = (0.5, 1, 2, 3, 5, 10, 15, 30)  # [m]
PANEL = 2.1  # [in] width of one image of the comparison
UNSCORED = "0.82"  # grey of what has no truth, or no value
ERROR_LIMIT = 10.0  # [%] relative depth error where the colour ends
ANGLE_LIMIT = 45.0  # [deg]
METHOD_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9")  # Okabe and Ito: told apart by everyone


@dataclass(frozen=True)
class Example:
    """One pair to show: left, right: (H, W, 3) uint8 as the methods saw them; predictions by method."""

    index: int
    left: np.ndarray
    right: np.ndarray
    truth: StereoTruth
    predictions: dict[str, Prediction]


def comparison_figure(examples: Sequence[Example], path: Path) -> None:
    """Write a PNG: two rows a pair (depth above, normals below); the images, the truth, then each method and its error.

    One scale for all methods: depth logarithmic, error in percent of the true depth, angles in degrees.
    """
    names = list(examples[0].predictions)
    columns = 2 + 2 * len(names)
    rows = 2 * len(examples)
    width, height = PANEL * columns + 0.4, PANEL * rows * _aspect(examples) + 1.2  # [in]
    figure = Figure(figsize=(width, height), dpi=110)
    grid = {"left": 0.38 / width, "right": 1 - 0.05 / width, "top": 1 - 0.32 / height, "bottom": 0.85 / height}
    axes = figure.subplots(rows, columns, squeeze=False, gridspec_kw={**grid, "wspace": 0.03, "hspace": 0.03})
    depths = np.concatenate([e.truth.depth[pixel_kinds(e.truth)["all"]] for e in examples])
    depth_norm = _depth_norm(depths)
    depth_map, error_map, angle_map = _map("viridis_r"), _map("magma"), _map("inferno")
    error_norm, angle_norm = Normalize(0, ERROR_LIMIT), Normalize(0, ANGLE_LIMIT)
    for pair, example in enumerate(examples):
        upper, lower = axes[2 * pair], axes[2 * pair + 1]
        truth, scored = example.truth, pixel_kinds(example.truth)["all"]
        _show(upper[0], example.left)
        _show(lower[0], example.right)
        _show(upper[1], _masked(truth.depth), cmap=depth_map, norm=depth_norm)
        _show(lower[1], _normals(truth.normal))
        upper[0].set_ylabel(f"pair {example.index}\nleft", fontsize=10)
        lower[0].set_ylabel("right", fontsize=10)
        for i, name in enumerate(names):
            prediction = example.predictions[name]
            depth_axes, error_axes = upper[2 + 2 * i : 4 + 2 * i]
            normal_axes, angle_axes = lower[2 + 2 * i : 4 + 2 * i]
            _show(depth_axes, _masked(prediction.depth), cmap=depth_map, norm=depth_norm)
            relative = np.zeros(scored.shape)
            relative[scored] = (
                100 * np.abs(capped_depth(prediction.depth) / np.where(scored, truth.depth, 1) - 1)[scored]
            )
            _show(error_axes, np.ma.masked_array(relative, ~scored), cmap=error_map, norm=error_norm)
            _note(error_axes, f"mean {relative[scored].mean():.1f} %" if scored.any() else "")
            if prediction.normal is None:
                _show(normal_axes, np.full((*scored.shape, 3), float(UNSCORED)))
                _show(angle_axes, np.full((*scored.shape, 3), float(UNSCORED)))
                continue
            oriented = scored & (np.linalg.norm(truth.normal, axis=-1) > 0.5)
            angle = np.zeros(scored.shape)
            angle[oriented] = angle_between(prediction.normal[oriented], truth.normal[oriented])
            _show(normal_axes, _normals(prediction.normal))
            _show(angle_axes, np.ma.masked_array(angle, ~oriented), cmap=angle_map, norm=angle_norm)
            _note(angle_axes, f"mean {angle[oriented].mean():.1f}°" if oriented.any() else "")
    titles = ["images", "truth", *(t for name in names for t in (name, f"{name}: error"))]
    for ax, title in zip(axes[0], titles, strict=True):
        ax.set_title(title, fontsize=12, fontweight="bold")
    bars = (
        (depth_norm, depth_map, "depth [m]  (grey: sky or unknown)", "both"),
        (error_norm, error_map, "depth error [% of the true depth]  (grey: not scored)", "max"),
        (angle_norm, angle_map, "angle between normals [deg]", "max"),
    )
    for i, (norm, colours, label, extend) in enumerate(bars):
        place = figure.add_axes(((i + 0.12) / 3, 0.52 / height, 0.76 / 3, 0.16 / height))
        mappable = matplotlib.cm.ScalarMappable(norm, colours)
        bar = figure.colorbar(mappable, cax=place, orientation="horizontal", extend=extend)
        _label_bar(bar, norm, label)
    _save(figure, path)


def prediction_figure(left: np.ndarray, prediction: Prediction, path: Path) -> None:
    """Write a PNG of one prediction: left image, depth, normals, confidence. left: (H, W) or (H, W, 3) uint8."""
    height, width = left.shape[:2]
    figure = Figure(figsize=(11, 1.0 + 10.2 * height / width), layout="constrained", dpi=110)
    (image_axes, depth_axes), (normal_axes, confidence_axes) = figure.subplots(2, 2)
    _show(image_axes, left if left.ndim == 3 else np.repeat(left[..., None], 3, axis=2))
    image_axes.set_title("left image")
    norm, colours = _depth_norm(prediction.depth[np.isfinite(prediction.depth)]), _map("viridis_r")
    shown = _show(depth_axes, _masked(prediction.depth), cmap=colours, norm=norm)
    bar = figure.colorbar(shown, ax=depth_axes, fraction=0.046, pad=0.02, extend="both")
    _label_bar(bar, norm, "depth [m]")
    depth_axes.set_title("depth (grey: sky or unknown)")
    if prediction.normal is not None:
        _show(normal_axes, _normals(prediction.normal))
        normal_axes.set_title("normals (red right, green up, blue to the camera)")
    else:
        normal_axes.set_axis_off()
    shown = _show(confidence_axes, prediction.confidence, cmap=_map("cividis"), norm=Normalize(0, 1))
    figure.colorbar(shown, ax=confidence_axes, fraction=0.046, pad=0.02)
    confidence_axes.set_title("confidence")
    _save(figure, path)


def interval_figure(results: dict[str, dict[str, Any]], path: Path, fb: float | None = None) -> None:
    """Write a PNG: error against true depth, in the 15 intervals of the paper's figure.

    results: Scores.result() by method. fb: focal length times baseline [px m] of the rig, to draw what a constant
    error of the disparity would give; None: not drawn.
    """
    figure = Figure(figsize=(11, 4.4), layout="constrained", dpi=120)
    panels = figure.subplots(1, 3)
    figures = (("mae", "mean absolute error [m]"), ("rmse", "RMSE [m]"), ("bad1", "disparities off by more than 1 px"))
    for ax, (key, label) in zip(panels, figures, strict=True):
        for (name, result), colour, marker in zip(results.items(), cycle(METHOD_COLOURS), cycle("osD^vPX")):
            rows = [r for r in result["intervals"] if r["pixels"]]
            centres = [(r["from_m"] + r["to_m"]) / 2 for r in rows]
            values = [r["pooled"][key] * (100 if key == "bad1" else 1) for r in rows]
            ax.plot(centres, values, marker=marker, color=colour, ms=5, lw=1.8, label=name)
        if fb and key == "mae":
            z = np.linspace(0.8, 15, 100)
            for pixels in (0.25, 1.0):
                ax.plot(z, z**2 * pixels / fb, color="0.6", lw=1, ls=":" if pixels < 1 else "--", zorder=1,
                        label=f"{pixels:g} px of disparity")  # fmt: skip
        if key == "bad1":
            ax.set_ylabel(f"{label} [%]")
            ax.set_ylim(bottom=0)
        else:
            ax.set_yscale("log")
            ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            ax.set_ylabel(label)
        ax.set_xlim(0, 15)
        ax.set_xticks(range(0, 16, 3))
        ax.set_xlabel("true depth [m]")
        ax.grid(True, which="major", color="0.9")
        ax.spines[["top", "right"]].set_visible(False)
        shares = ax.twinx()
        first = next(iter(results.values()))["intervals"]
        total = max(1, sum(r["pixels"] for r in first))
        shares.bar([(r["from_m"] + r["to_m"]) / 2 for r in first], [r["pixels"] / total for r in first],
                   width=0.9, color="0.93", zorder=0)  # fmt: skip
        shares.set_ylim(0, 2.5 * max(max(r["pixels"] for r in first) / total, 1e-6))
        shares.set_axis_off()
        ax.set_zorder(shares.get_zorder() + 1)
        ax.patch.set_visible(False)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), frameon=False)
    figure.supxlabel("bars: share of the scored pixels", fontsize=8, color="0.45")
    _save(figure, path)


def _aspect(examples: Sequence[Example]) -> float:
    """Height over width of the first pair."""
    height, width = examples[0].left.shape[:2]
    return height / width


def _map(name: str) -> Colormap:
    return matplotlib.colormaps[name].with_extremes(bad=UNSCORED)


def _normals(normal: np.ndarray) -> np.ndarray:
    """(H, W, 3) uint8 colours of normals on the grey of what is unknown, which normal_colours leaves black."""
    colours = normal_colours(normal)
    colours[(colours == 0).all(axis=-1)] = round(255 * float(UNSCORED))
    return colours


def _masked(depth: np.ndarray) -> np.ma.MaskedArray:
    return np.ma.masked_array(depth, ~(np.isfinite(depth) & (depth > 0)))


def _depth_norm(depths: np.ndarray) -> LogNorm:
    """Logarithmic scale over what is there (2nd to 98th percentile), from 0.3 m at the lowest to 30 m at most."""
    depths = depths[np.isfinite(depths) & (depths > 0)]
    low, high = np.percentile(depths, [2, 98]) if len(depths) else (1.0, 15.0)
    low, high = float(np.clip(low, 0.3, 25)), float(np.clip(high, 0.6, 30))
    return LogNorm(low, max(high, 1.5 * low))


def _label_bar(bar: Any, norm: Normalize, label: str) -> None:
    bar.set_label(label, fontsize=10)
    if isinstance(norm, LogNorm):
        low, high = norm.vmin or 0, norm.vmax or 1
        bar.locator = FixedLocator([t for t in DEPTH_TICKS if low <= t <= high])
        bar.formatter = FuncFormatter(lambda value, _: f"{value:g}")
        bar.minorlocator = NullLocator()
        bar.update_ticks()


def _show(ax: Axes, image: np.ndarray, **options: Any) -> Any:
    ax.set_xticks([])
    ax.set_yticks([])
    for spine in ax.spines.values():
        spine.set_visible(False)
    return ax.imshow(image, interpolation="nearest", **options)


def _note(ax: Axes, text: str) -> None:
    ax.text(0.97, 0.96, text, transform=ax.transAxes, ha="right", va="top", fontsize=9,
            bbox={"facecolor": "white", "alpha": 0.85, "edgecolor": "none", "pad": 2})  # fmt: skip


def _save(figure: Figure, path: Path) -> None:
    """Drawn by Agg into memory and written in one go. Raises OSError."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    pixels = np.asarray(canvas.buffer_rgba())[..., :3]
    ok, data = cv2.imencode(".png", cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_PNG_COMPRESSION, 6])
    if not ok:
        raise OSError(f"{path}: the figure could not be encoded")
    path.write_bytes(data.tobytes())
