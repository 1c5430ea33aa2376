"""Colours, scales and files that all figures share.

They use matplotlib's object interface: no display, no global state.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import cycle
from os.path import commonprefix
from pathlib import Path
from typing import Any

import cv2
import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from marssim.base.files.atomic import write_atomically
from marssim.base.files.png import encode_png
from marssim.base.images.colours import DEPTH_TICKS, normal_colours
from marssim.base.images.figure_pixels import figure_pixels

FLATTEST, TALLEST = 1 / 8, 4.0  # height by width of an image, beyond which figures leave room beside it
UNSCORED = "0.82"  # grey of pixels without truth or without a value
# Colours of Okabe and Ito, which colour-blind readers can distinguish, and two more.
METHOD_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#000000", "#8c6d31")
METHOD_MARKERS = "osD^vPX*"
LONGEST = 60  # characters of a name in a legend, so that it fits into its figure
KEPT = 8  # characters of what names have in common before they differ


def method_styles() -> Iterator[dict[str, str]]:
    """Yield line styles of methods without end, as keywords of Axes.plot: the first 128 differ.

    After each round of the colours, full marks become hollow. After hollow ones, marks are full again, and each colour
    has the mark that follows its last one.
    """
    for shift in cycle(range(len(METHOD_MARKERS))):
        markers = METHOD_MARKERS[shift:] + METHOD_MARKERS[:shift]
        for hollow in (False, True):
            for colour, marker in zip(METHOD_COLOURS, markers, strict=True):
                yield {"color": colour, "marker": marker, "markerfacecolor": "white" if hollow else colour}


def plain_label(label: str) -> str:
    """Return a label that matplotlib shows as it is.

    It takes what is between two $ for a formula, and leaves out labels that begin with an underscore.
    """
    label = label.replace("$", r"\$")
    return f" {label}" if label.startswith("_") else label


def legend_labels(names: Sequence[str]) -> list[str]:
    """Return the labels of a legend, as plain_label does each.

    A name of more than LONGEST characters, as with the path of a file, loses its middle. Names that would be equal then
    lose their common beginning first.
    """
    short = [_without_middle(name) for name in names]
    for cut in {cut for cut in short if short.count(cut) > 1}:
        alike = [n for n, other in enumerate(short) if other == cut]
        begin = max(0, len(commonprefix([names[n] for n in alike])) - KEPT)  # noqa: RUF071 - characters are meant
        for n in alike:
            short[n] = _without_middle(f"…{names[n][begin:]}")
    return [plain_label(name) for name in short]


def _without_middle(name: str) -> str:
    half = LONGEST // 2
    return name if len(name) <= LONGEST else f"{name[: half - 1]}…{name[-half:]}"


def panel_aspect(image: np.ndarray) -> float:
    """Return height by width of an image's place in a figure.

    It is bounded, as a figure of an image with few columns would be so high that it fits into no memory.

    Args:
        image: (H, W) or (H, W, 3).
    """
    return float(np.clip(image.shape[0] / image.shape[1], FLATTEST, TALLEST))


def colour_map(name: str) -> Colormap:
    """Return a colour map of matplotlib, with grey for masked pixels."""
    return matplotlib.colormaps[name].with_extremes(bad=UNSCORED)


def normal_image(normal: np.ndarray) -> np.ndarray:
    """Return (H, W, 3) uint8 colours of normals; unknown ones are grey, where normal_colours has black."""
    colours = normal_colours(normal)
    colours[(colours == 0).all(axis=-1)] = round(255 * float(UNSCORED))
    return colours


def masked_depth(depth: np.ndarray) -> np.ma.MaskedArray:
    """Return depth with sky and unknown pixels masked."""
    return np.ma.masked_array(depth, ~(np.isfinite(depth) & (depth > 0)))


def depth_scale(depths: np.ndarray, whole: bool = False, farthest: float = 30.0) -> LogNorm:
    """Return a logarithmic scale of depth.

    Args:
        depths: Depths [m] that the scale should hold: their 2nd to 98th percentile. It begins under 0.3 m only if they
            are all within 1 m.
        whole: Whether the scale goes from the nearest to the farthest depth instead.
        farthest: Largest depth [m] at which the scale may end.
    """
    depths = depths[np.isfinite(depths) & (depths > 0)]
    low, high = np.percentile(depths, [0, 100] if whole else [2, 98]) if len(depths) else (1.0, 15.0)
    if high > 1:
        low, high = float(np.clip(low, 0.3, 25)), min(high, farthest)
    return LogNorm(float(low), float(max(high, (1.05 if whole else 1.5) * low)))


def label_bar(bar: Any, norm: Normalize, label: str) -> None:
    """Label a colour bar; a logarithmic one gets round depths as ticks, or its ends where it is too short for them.

    Args:
        bar: The colour bar.
        norm: Its scale.
        label: Its label.
    """
    bar.set_label(label, fontsize=10)
    if isinstance(norm, LogNorm):
        low, high = norm.vmin or 0, norm.vmax or 1
        ticks = [t for t in DEPTH_TICKS if low <= t <= high]
        bar.locator = FixedLocator(ticks if len(ticks) > 1 else [low, high])
        bar.formatter = FuncFormatter(lambda value, _: f"{value:.3g}")
        bar.minorlocator = NullLocator()
        bar.update_ticks()


def show(ax: Axes, image: np.ndarray, **options: Any) -> Any:
    """Draw an image without ticks and frame, and return imshow's result.

    Args:
        ax: The axes.
        image: (H, W) or (H, W, 3) image.
        **options: Options of imshow.
    """
    ax.set_xticks([])
    ax.set_yticks([])
    for spine in ax.spines.values():
        spine.set_visible(False)
    return ax.imshow(image, interpolation="nearest", **options)


def note(ax: Axes, text: str, corner: str = "upper right") -> None:
    """Write words into a corner of an image.

    Args:
        ax: The axes of the image.
        text: The words.
        corner: "upper right" or "lower left".
    """
    x, y, ha, va = (0.97, 0.96, "right", "top") if corner == "upper right" else (0.03, 0.04, "left", "bottom")
    ax.text(x, y, text, transform=ax.transAxes, ha=ha, va=va, fontsize=9,
            bbox={"facecolor": "white", "alpha": 0.85, "edgecolor": "none", "pad": 2})  # fmt: skip


def save(figure: Figure, path: Path) -> np.ndarray:
    """Draw a figure with Agg, and write it as PNG in one step.

    Args:
        figure: The figure.
        path: The file to write.

    Returns:
        (H, W, 3) uint8 RGB, the picture.

    Raises:
        OSError: The file cannot be written; the message names it.
    """
    pixels = figure_pixels(figure)
    write_atomically(path, encode_png(pixels[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 6]))
    return pixels
