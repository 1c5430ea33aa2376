"""Points of the left image and where the right one shows them, for pairs whose rows may lie apart.

Corners of a reduced left image are searched in the right one by normalised cross-correlation, in a band of rows and
over all disparities that the rig can have. `followed` finds the places to a few hundredths of a pixel (Lucas and
Kanade, in OpenCV's implementation).
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from m3depth.stereo.pairs import largest_disparity
from marssim.base.camera import StereoRig

SEARCH_WIDTH = 256  # [px] width of the reduced images in which corners are searched
CELLS = 8  # rows and columns of cells, which all give equally many corners
CORNERS = 6  # most corners of a cell
PATCH = 11  # side of the compared windows [px of the reduced images], odd
CORNER_WINDOW = 5  # side of the windows over which gradients are summed, and of those with one corner each [px]
SEARCH_BLUR = 0.8  # standard deviation of the blur of the reduced images [px], against their noise and aliasing
LEAST_CORRELATION = 0.7  # of two windows that show the same
BEYOND = 1 / 64  # share of the width by which disparities may be negative: eyes that squint
WINDOW = 11  # side of the windows that are followed [px], odd
BLUR = 0.7  # standard deviation of the blur before that [px]
CONTRAST_WINDOW = 31  # side of the windows in which brightness and contrast are evened out [px], odd
LEAST_CONTRAST = 1.0  # [grey levels] deviation that is not enlarged further
EVENED_MEAN, EVENED_DEVIATION = 128, 40  # grey levels of evened images: +-3 deviations fit into 8 bits
ROUNDS = 20  # most steps of Lucas and Kanade
SMALLEST_STEP = 0.005  # [px] step after which they end, well under their error
STRAYED = 2.0  # errors of the guess beyond which a point has been followed to another one
RETURN_ERROR = 0.3  # [px] within which a point that is followed back must return


def band_matches(left: np.ndarray, right: np.ndarray, rig: StereoRig, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Match corners of the left image in a band of rows of the right one, to a pixel of the reduced images.

    Args:
        left: (H, W) uint8.
        right: (H, W) uint8.
        rig: The cameras of these images.
        reach: How far rows may lie apart [px].

    Returns:
        Places (N, 2) in the left and in the right image, column and row [px].
    """
    height, width = left.shape
    scale = min(1.0, SEARCH_WIDTH / width)
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    a, b = (
        cv2.GaussianBlur(cv2.resize(i, size, interpolation=cv2.INTER_AREA), (0, 0), SEARCH_BLUR) for i in (left, right)
    )
    along = math.ceil(largest_disparity(rig) * scale)
    beyond, rows = math.ceil(BEYOND * size[0]), math.ceil(reach * scale)
    margin = PATCH // 2
    band = cv2.copyMakeBorder(b, rows, rows, along, beyond, cv2.BORDER_REPLICATE)
    matches = []
    for x, y in _spread_corners(a, margin):
        patch = a[y - margin : y + margin + 1, x - margin : x + margin + 1]
        strip = band[y - margin : y + margin + 1 + 2 * rows, x - margin : x + margin + 1 + along + beyond]
        _, likeness, _, (column, row) = cv2.minMaxLoc(cv2.matchTemplate(strip, patch, cv2.TM_CCOEFF_NORMED))
        if LEAST_CORRELATION < likeness < np.inf:
            matches.append((x, y, x + column - along, y + row - rows))
    places = np.array(matches, float).reshape(-1, 2, 2)
    places = (places + 0.5) * [width / size[0], height / size[1]] - 0.5
    return places[:, 0], places[:, 1]


def _spread_corners(grey: np.ndarray, margin: int) -> np.ndarray:
    """Return (N, 2) int columns and rows of the strongest corners (Shi and Tomasi) of each cell."""
    height, width = grey.shape
    strength = np.zeros(grey.shape, np.float32)
    inner = (slice(margin, height - margin), slice(margin, width - margin))
    every = cv2.cornerMinEigenVal(grey, CORNER_WINDOW)
    highest = cv2.dilate(every, np.ones((CORNER_WINDOW, CORNER_WINDOW), np.uint8))
    strength[inner] = np.where(every == highest, every, 0)[inner]
    corners = [np.zeros((0, 2), int)]
    for rows in np.array_split(np.arange(height), CELLS):
        for columns in np.array_split(np.arange(width), CELLS):
            if not (len(rows) and len(columns)):
                continue
            part = strength[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
            best = np.argpartition(part, -min(CORNERS, part.size), axis=None)[-CORNERS:]
            y, x = np.unravel_index(best[part.flat[best] > 0], part.shape)
            corners.append(np.column_stack([x + columns[0], y + rows[0]]))
    return np.concatenate(corners)


def followed(
    left: np.ndarray, right: np.ndarray, start: np.ndarray, guess: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Find points in the right image to a few hundredths of a pixel.

    Args:
        left: (H, W) uint8.
        right: (H, W) uint8.
        start: (N, 2) columns and rows in the left image [px].
        guess: (N, 2) places in the right image, to a pixel of the images of SEARCH_WIDTH.

    Returns:
        (N, 2) places in the right image, and (N,) bool, which of them can be trusted.
    """
    error = max(1.0, left.shape[1] / SEARCH_WIDTH)  # [px] of the guess
    levels = max(0, round(math.log2(error)) - 1)
    a, b = (_evened(image) for image in (left, right))
    forth, arrived = _lucas_kanade(a, b, start, guess, levels)
    back, returned = _lucas_kanade(b, a, forth, start, levels)
    near = (np.abs(forth - guess) <= STRAYED * error).all(axis=1)
    return forth, arrived & returned & near & (np.abs(back - start).max(axis=1, initial=0) <= RETURN_ERROR)


def _evened(image: np.ndarray) -> np.ndarray:
    """Return an image (H, W) uint8, slightly blurred, with the same brightness and contrast everywhere.

    The eyes may differ in both, by gain or dust, and to follow a point is to find equal grey levels.
    """
    window = (CONTRAST_WINDOW, CONTRAST_WINDOW)
    smooth = cv2.GaussianBlur(image.astype(np.float32), (0, 0), BLUR)
    detail = smooth - cv2.blur(smooth, window)
    deviation = np.sqrt(np.maximum(cv2.blur(detail * detail, window), 0))  # rounding makes it negative in black parts
    evened = EVENED_MEAN + EVENED_DEVIATION * detail / np.maximum(deviation, LEAST_CONTRAST)
    return np.clip(evened, 0, 255).astype(np.uint8)


def _lucas_kanade(
    a: np.ndarray, b: np.ndarray, start: np.ndarray, guess: np.ndarray, levels: int
) -> tuple[np.ndarray, np.ndarray]:
    first, second = (np.ascontiguousarray(places[:, None], np.float32) for places in (start, guess))
    places, tracked, _ = cv2.calcOpticalFlowPyrLK(
        a, b, first, second.copy(), winSize=(WINDOW, WINDOW), maxLevel=levels, flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        criteria=(cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, ROUNDS, SMALLEST_STEP),
    )  # fmt: skip
    return places[:, 0].astype(float), tracked[:, 0] == 1
