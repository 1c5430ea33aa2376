"""The picture of one prediction: image, depth, normals and confidence. It takes milliseconds, for pairs by the hundred.

What is unknown is black in all maps, and sky is grey, as is depth beyond the scale.
"""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np

from m3depth.stereo.pairs import in_colour
from m3depth.stereo.prediction import Prediction
from marssim.base.files.atomic import write_atomically
from marssim.base.files.png import encode_png
from marssim.base.images.colours import (
    CONFIDENCE_TITLE,
    DEPTH_TICKS,
    NORMAL_TITLE,
    confidence_colours,
    depth_bar,
    depth_colours,
    normal_colours,
)

FARTHEST = 300.0  # [m] largest depth at which the scale of a wide view may end
NARROW = 1.6  # largest ratio of depths for which the scale has ends of its own
LEAST, MOST = 240, 640  # [px] width of a map in the picture
HIGHEST = 1600  # [px] height of a map in the picture; one of few columns becomes narrower than LEAST
LINE = 20  # [px] height of a line of text
GAP = 6  # [px] between two maps
TEXT = cv2.FONT_HERSHEY_SIMPLEX, 0.42, (30, 30, 30), 1, cv2.LINE_AA  # font, size, colour, weight
PAPER = 255  # grey level of the ground


def depth_range_shown(depth: np.ndarray) -> tuple[float, float]:
    """Return round depths [m] around the 2nd to 98th percentile of a map of depth, for the scale of its picture."""
    finite = depth[np.isfinite(depth) & (depth > 0)]
    if not finite.size:
        return 1.0, 15.0
    low, high = (float(value) for value in np.percentile(finite, [2, 98]))
    if high < NARROW * low or low > FARTHEST / NARROW or high <= DEPTH_TICKS[0]:
        return _narrow_range(low, high)
    near = max((tick for tick in DEPTH_TICKS if tick <= low), default=DEPTH_TICKS[0])
    far = min((tick for tick in DEPTH_TICKS if tick >= high), default=FARTHEST)
    return near, min(far, FARTHEST)


def _narrow_range(low: float, high: float) -> tuple[float, float]:
    """Return depths [m] of two digits around a small range; a scale between usual ticks would show one colour."""
    step = 10.0 ** (math.floor(math.log10(low)) - 1)
    near, far = math.floor(low / step - 0.5) * step, math.ceil(high / step + 0.5) * step
    return round(near, 6), round(far, 6)


def prediction_picture(left: np.ndarray, prediction: Prediction, shown: tuple[float, float]) -> np.ndarray:
    """Return the picture, (h, w, 3) uint8 RGB.

    Args:
        left: (H, W) or (H, W, 3) uint8 left image.
        prediction: Its maps.
        shown: Nearest and farthest depth [m] of the scale, as of depth_range_shown.
    """
    near, far = shown
    unknown = np.isnan(prediction.depth)
    confidence = confidence_colours(prediction.confidence)
    confidence[unknown] = 0
    maps = [
        ("left image", in_colour(left)),
        (f"depth: {near:g} m yellow to {far:g} m violet", depth_colours(prediction.depth, near, far)),
    ]
    if prediction.normal is not None:
        maps.append((NORMAL_TITLE, normal_colours(prediction.normal)))
    maps.append((CONFIDENCE_TITLE, confidence))
    parts = [titled(title, sized(image)) for title, image in maps]
    height, width = parts[0].shape[:2]
    page = np.full((2 * height + LINE + 12, 2 * width + GAP, 3), PAPER, np.uint8)
    for number, part in enumerate(parts):
        row, column = divmod(number, 2)
        page[row * height : (row + 1) * height, column * (width + GAP) :][:, :width] = part
    draw_scale(page[2 * height :], width, near, far)
    return page


def prediction_figure(left: np.ndarray, prediction: Prediction, path: Path, shown: tuple[float, float]) -> None:
    """Write the picture of a prediction as PNG.

    Args:
        left: (H, W) or (H, W, 3) uint8 left image.
        prediction: Its maps.
        path: The file to write.
        shown: Nearest and farthest depth [m] of the scale.

    Raises:
        OSError: The file cannot be written; the message names it.
    """
    picture = prediction_picture(left, prediction, shown)
    write_atomically(path, encode_png(picture[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 1]))


def sized(image: np.ndarray, most: int = MOST) -> np.ndarray:
    """Return an image at a width of LEAST to `most` px, with white beside one that is too high for that.

    Args:
        image: (H, W, 3) uint8.
        most: Largest width [px].
    """
    height, width = image.shape[:2]
    factor = min(math.ceil(LEAST / width) if width < LEAST else min(1.0, most / width), HIGHEST / height)
    if factor != 1:
        size = max(1, round(width * factor)), max(1, round(height * factor))
        image = cv2.resize(image, size, interpolation=cv2.INTER_NEAREST if factor > 1 else cv2.INTER_AREA)
    missing = max(0, LEAST - image.shape[1])
    return cv2.copyMakeBorder(image, 0, 0, 0, missing, cv2.BORDER_CONSTANT, value=(PAPER,) * 3) if missing else image


def titled(title: str, image: np.ndarray) -> np.ndarray:
    """Return an image, (H, W, 3) uint8, with a line of text above it, as small as it has to be."""
    bar = np.full((LINE, image.shape[1], 3), PAPER, np.uint8)
    _write(bar, title, 2, LINE - 6)
    return np.concatenate([bar, image])


def _write(image: np.ndarray, text: str, x: int, y: int) -> None:
    font, size, colour, weight, line = TEXT
    length = cv2.getTextSize(text, font, size, weight)[0][0]
    size *= min(1.0, (image.shape[1] - x - 2) / max(length, 1))
    cv2.putText(image, text, (x, y), font, size, colour, weight, line)


def draw_scale(strip: np.ndarray, width: int, near: float, far: float) -> None:
    """Draw the scale of depth into a strip, and what grey and black mean beside it.

    Args:
        strip: (LINE + 12, W, 3) uint8, below the maps; it is drawn into.
        width: Width of the scale, which is that of a map [px].
        near, far: Ends of the scale [m].
    """
    ticks = [near, *(tick for tick in DEPTH_TICKS if near * 1.2 < tick < far / 1.2), far]
    bar, columns = depth_bar(width, 10, ticks)
    strip[2:12, :width] = bar
    font, size, colour, weight, line = TEXT
    end = -1
    for tick, column in zip(ticks, columns):
        text = f"{tick:g} m"
        length = cv2.getTextSize(text, font, size, weight)[0][0]
        x = min(max(column - length // 2, 0), width - length)
        if x > end + 8 or tick == near:
            cv2.putText(strip, text, (x, 26), font, size, colour, weight, line)
            end = x + length
    _write(strip[:, width + GAP :], "grey: sky, or farther; black: unknown", 2, 12)
