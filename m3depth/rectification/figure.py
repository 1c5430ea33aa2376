"""The picture by which a person judges a rectification: matched rows, before and after, whole and in detail."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from m3depth.rectification.pair import Matches, RectifiedPair
from m3depth.rectification.raw_image import RawImage, for_matching
from m3depth.rectification.row_errors import RowErrors
from marssim.base.files.atomic import write_atomically
from marssim.base.files.png import encode_png
from marssim.base.images.figure_pixels import figure_pixels

LINES = 16  # matched rows that are drawn
DETAILS = 6  # matches that are enlarged
HALF, TIMES = 12, 8  # half the side [px] of an enlarged piece, and how often it is enlarged
COLOURS = ("#e69f00", "#56b4e9", "#f0e442", "#cc79a7")


def rows_figure(left: RawImage, right: RawImage, pair: RectifiedPair, path: Path) -> None:
    """Write a PNG of the matched rows of a pair, before and after.

    Args:
        left, right: The raw images.
        pair: The rectified pair.
        path: The file to write.
    """
    raw = [for_matching(image.pixels, image.valid) for image in (left, right)]
    done = [for_matching(*eye) for eye in ((pair.left, pair.left_valid), (pair.right, pair.right_valid))]
    figure = Figure(figsize=(12, 15), layout="constrained", dpi=110)
    grid = figure.add_gridspec(4, 2, height_ratios=[4, 4, 1.3, 3.4], width_ratios=[3, 2])
    before, after, detail = (figure.add_subplot(grid[row, :]) for row in range(3))
    matches = pair.matches
    if matches is None:
        _side_by_side(before, raw, "raw: too few points match to judge the rows")
        _side_by_side(after, done, "rectified")
        detail.set_axis_off()
    else:
        chosen = _spread(matches.left, LINES)
        _rows(before, raw, matches.raw_left[chosen], matches.raw_right[chosen], f"raw: rows {_words(matches.before)}")
        _rows(after, done, matches.left[chosen], matches.right[chosen], f"rectified: rows {_words(matches.after)}")
        _details(detail, done, matches)
        _residuals(figure, figure.add_subplot(grid[3, 0]), matches, done[0])
        _histogram(figure.add_subplot(grid[3, 1]), matches)
    write_atomically(path, encode_png(figure_pixels(figure)[..., ::-1]))


def _words(rows: RowErrors) -> str:
    return f"{rows.median:.2f} px apart (median of {rows.points} matches; 95 % within {rows.most:.2f} px)"


def _side_by_side(axes: Axes, images: list[np.ndarray], title: str) -> int:
    """Show two images beside each other, and return the column at which the right one begins."""
    height = max(image.shape[0] for image in images)
    padded = [cv2.copyMakeBorder(x, 0, height - x.shape[0], 0, 0, cv2.BORDER_CONSTANT) for x in images]
    gap = np.full((height, max(8, images[0].shape[1] // 80)), 255, np.uint8)
    axes.imshow(np.hstack([padded[0], gap, padded[1]]), cmap="gray", vmin=0, vmax=255)
    axes.set_title(title, fontsize=11)
    axes.set_axis_off()
    return images[0].shape[1] + gap.shape[1]


def _rows(axes: Axes, images: list[np.ndarray], left: np.ndarray, right: np.ndarray, title: str) -> None:
    """Draw a line along the row of each left point; a cross marks where the right image shows it."""
    start = _side_by_side(axes, images, title)
    width = start + images[1].shape[1]
    for number, (a, b) in enumerate(zip(left, right)):
        colour = COLOURS[number % len(COLOURS)]
        axes.plot([a[0], width], [a[1], a[1]], color=colour, linewidth=0.6)
        axes.plot(a[0], a[1], "o", markersize=4, markerfacecolor="none", color=colour)
        axes.plot(start + b[0], b[1], "+", markersize=7, color=colour)
    axes.set_xlim(-0.5, width - 0.5)
    axes.set_ylim(max(image.shape[0] for image in images) - 0.5, -0.5)


def _details(axes: Axes, images: list[np.ndarray], matches: Matches) -> None:
    """Show pieces around matches of both rectified images, enlarged, with the row of the left point through both."""
    axes.set_axis_off()
    inner = np.ones(len(matches.left), bool)
    for image, places in zip(images, (matches.left, matches.right)):
        inner &= ((places > HALF) & (places < np.array(image.shape[::-1]) - 1 - HALF)).all(axis=1)
    chosen = np.flatnonzero(inner)[_spread(matches.left[inner], DETAILS)]
    if not len(chosen):
        return
    pieces = []
    for a, b in zip(matches.left[chosen], matches.right[chosen]):
        both = [
            cv2.getRectSubPix(image, (2 * HALF + 1,) * 2, (float(point[0]), float(a[1])))
            for image, point in zip(images, (a, b))
        ]
        pieces.append(np.hstack([*both, np.full((2 * HALF + 1, 3), 255, np.uint8)]))
    strip = np.hstack(pieces)
    axes.imshow(cv2.resize(strip, None, fx=TIMES, fy=TIMES, interpolation=cv2.INTER_CUBIC), cmap="gray")
    axes.axhline((HALF + 0.5) * TIMES, color=COLOURS[0], linewidth=0.7)
    axes.set_title("rectified, enlarged: the left and the right image around one match, on one row", fontsize=11)


def _residuals(figure: Figure, axes: Axes, matches: Matches, left: np.ndarray) -> None:
    """Show where in the left image the rows of matches lie apart."""
    axes.imshow(left, cmap="gray", vmin=0, vmax=510)
    bound = max(0.2, matches.after.most)
    distance = (matches.right - matches.left)[:, 1]
    shown = axes.scatter(
        matches.left[:, 0], matches.left[:, 1], c=distance, s=3, cmap="coolwarm", vmin=-bound, vmax=bound
    )
    figure.colorbar(shown, ax=axes, fraction=0.04, pad=0.02, label="right row less left row [px]")
    axes.set_title("what is left over", fontsize=11)
    axes.set_axis_off()


def _histogram(axes: Axes, matches: Matches) -> None:
    distances = [(b - a)[:, 1] for a, b in ((matches.raw_left, matches.raw_right), (matches.left, matches.right))]
    bound = float(np.clip(np.percentile(np.abs(distances[0]), 95), 1, 40))
    bins = np.linspace(-bound, bound, 81).tolist()
    for values, colour, name in zip(distances, ("0.6", "#0072b2"), ("raw", "rectified")):
        axes.hist(np.clip(values, -bound, bound), bins=bins, color=colour, label=name)
    axes.set_xlabel("right row less left row [px]")
    axes.set_ylabel("matches")
    axes.legend(frameon=False)


def _spread(places: np.ndarray, count: int) -> np.ndarray:
    """Return the numbers of at most `count` places that lie far from each other, from top to bottom."""
    if not len(places):
        return np.zeros(0, int)
    chosen = [int(np.argmin(places.sum(axis=1)))]
    nearest = np.full(len(places), np.inf)
    for _ in range(min(count, len(places)) - 1):
        nearest = np.minimum(nearest, np.linalg.norm(places - places[chosen[-1]], axis=1))
        chosen.append(int(nearest.argmax()))
    return np.array(sorted(chosen, key=lambda i: places[i, 1]))
