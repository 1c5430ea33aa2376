"""Draw a contact sheet: some samples of a dataset side by side."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from marssim.base.dataset.sample import StereoSample
from marssim.base.images.colours import NORMAL_TITLE, depth_bar, depth_colours, depth_ticks, normal_colours

ROWS = ("left eye", "right eye", "depth", "normals")
PAPER, INK = 24, (230, 230, 230)  # grey level of the sheet, and colour of its text
GAP = 3  # [px] between images
SIDE = 24  # [px] width of the column with the rows' names
LINE = 18  # [px] height of a line of text
NORMAL, SMALL = 0.4, 0.35  # sizes of the text, in OpenCV's unit
TALLEST = 2.0  # largest height of an image on the sheet, over the width of a tile


def contact_sheet(
    samples: Sequence[StereoSample], names: Sequence[str], columns: int = 6, tile: int = 192, total: int | None = None
) -> np.ndarray:
    """Draw samples side by side, each as a column of both eyes, depth and normals, headed by its name.

    Args:
        samples: The samples, at least one; their images may differ in size.
        names: "scene/view" of each.
        columns: Number of samples side by side; further ones go below.
        tile: Width of each image on the sheet [px]; less for images more than twice as high as wide.
        total: Number of samples of the dataset. The legend names it if the sheet shows fewer.

    Returns:
        (H, W, 3) uint8 RGB. The legend at the bottom has the scale of depth, which is the same on all sheets, except on
        one that shows nothing farther than 1 m.

    Raises:
        ValueError: There is no sample.
    """
    if not samples:
        raise ValueError("a contact sheet needs at least one sample")
    height = max(*(_size(sample, tile)[1] for sample in samples), *map(_text_width, ROWS))
    ticks = depth_ticks(sample.depth for sample in samples)
    part = f"{len(samples)} of {total} pairs; " if total is not None and total > len(samples) else ""
    strips = [_strip(sample, name, tile, height, ticks) for sample, name in zip(samples, names)]
    columns = min(columns, len(strips))
    strips += [np.full_like(strips[0], PAPER)] * (-len(strips) % columns)
    bands = [
        np.hstack([_row_names(height), *strips[start : start + columns]]) for start in range(0, len(strips), columns)
    ]
    return np.vstack([*bands, _legend(bands[0].shape[1], part, ticks)])


def _size(sample: StereoSample, tile: int) -> tuple[int, int]:
    """Return width and height [px] of a sample's images on tiles of a width."""
    height, width = sample.depth.shape
    scale = min(tile / width, TALLEST * tile / height)
    return max(1, round(scale * width)), max(1, round(scale * height))


def _strip(sample: StereoSample, name: str, width: int, height: int, ticks: tuple[float, ...]) -> np.ndarray:
    """Draw one sample: two lines of text, and its images one below the other."""
    strip = _blank(2 * LINE + len(ROWS) * (height + GAP), width + GAP)
    meta = sample.meta
    _write(strip, name, (2, 13))
    _write(strip, f"{meta.get('preset', '')} sun {_degrees(meta.get('sun_elevation_deg'))}", (2, 13 + LINE), SMALL)
    depth = depth_colours(sample.depth, ticks[0], ticks[-1])
    size = _size(sample, width)
    for row, image in enumerate((sample.left, sample.right, depth, normal_colours(sample.normal))):
        top = 2 * LINE + row * (height + GAP)
        strip[top : top + size[1], : size[0]] = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    return strip


def _degrees(value: object) -> str:
    return f"{value:.0f} deg" if isinstance(value, int | float) else "?"


def _row_names(height: int) -> np.ndarray:
    """Draw what the rows show, written upwards beside them."""
    names = [np.zeros((0, SIDE, 3), np.uint8)]
    for name in ROWS:
        line = _blank(SIDE, height + GAP)
        _write(line, name, ((height - _text_width(name)) // 2, 16))
        names.append(np.rot90(line))
    return np.vstack([_blank(2 * LINE, SIDE), *names])


def _legend(width: int, part: str, ticks: tuple[float, ...]) -> np.ndarray:
    """Draw the scale of depth, and below it `part` and a text on grey and on the colours of normals."""
    lines = _wrapped(f"{part}depth [m], grey beyond {ticks[-1]:g} m; {NORMAL_TITLE}", width - SIDE - GAP)
    bar, columns = depth_bar(min(420, width - SIDE - 16), ticks=ticks)
    legend = _blank(3 * LINE + len(lines) * LINE, width)
    legend[8 : 8 + len(bar), SIDE : SIDE + bar.shape[1]] = bar
    free = 0  # column from which on no label is written yet
    for metres, column in zip(ticks, columns):
        legend[20:24, SIDE + column] = INK
        text = f"{metres:g}"
        wide = _text_width(text, SMALL)
        left = SIDE + column - wide // 2
        if left >= free:
            _write(legend, text, (left, 36), SMALL)
            free = left + wide + GAP
    for row, line in enumerate(lines):
        _write(legend, line, (SIDE, 3 * LINE + 4 + row * LINE), SMALL)
    return legend


def _wrapped(text: str, width: int) -> list[str]:
    """Return a text as lines of at most that width [px]."""
    lines: list[str] = []
    for word in text.split():
        longer = f"{lines[-1]} {word}" if lines else word
        if lines and _text_width(longer, SMALL) <= width:
            lines[-1] = longer
        else:
            lines.append(word)
    return lines


def _blank(height: int, width: int) -> np.ndarray:
    return np.full((height, width, 3), PAPER, np.uint8)


def _text_width(text: str, size: float = NORMAL) -> int:
    return cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, size, 1)[0][0]


def _write(image: np.ndarray, text: str, at: tuple[int, int], size: float = NORMAL) -> None:
    cv2.putText(image, text, at, cv2.FONT_HERSHEY_SIMPLEX, size, INK, 1, cv2.LINE_AA)
