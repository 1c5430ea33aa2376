"""The files of a map: GeoTIFF layers that planners and GIS programs read, and a picture to look at."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from marssim.base.files.atomic import write_atomically
from marssim.base.files.geotiff import FRAME, encode_geotiff
from marssim.base.files.png import encode_png
from nav.ground.elevation import ElevationMap
from nav.ground.traversability import Traversability

RESULT = "map.json"  # written last: a folder that has it holds a whole map
MOST_CELLS = 4000  # along a side of a map
FREE, NEAR, BLOCKED, UNKNOWN = 0, 1, 2, 255  # values of traversability.tif
COSTLY = 4.0  # extra cost of a metre at which free ground is drawn yellow
UNKNOWN_COLOUR = (128, 128, 128)
ROVER_FRAME = "frame of the rover: x ahead, y left, metres"
TRAVERSABILITY_TITLE = "green free, yellow costly, orange too near to an obstacle, red obstacle, grey unknown"
LEAST = 600  # [px] longer side of the picture from which on a cell is one pixel
LEGEND_WIDTH = 340  # [px]
BORDER = 6  # [px] around the picture, for cameras at its edge
LEFT = 62  # [px] width of the numbers left of the picture
STRIP = 92  # [px] height of what is written below the picture
TICK_GAP = 70  # [px] least distance of two numbers of an axis
ARROW = 30  # [px] length of the arrow of a camera
MOST_ARROWS = 40  # cameras; more have none
BARS = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100)  # [m] lengths of the bar
FONT = (cv2.FONT_HERSHEY_SIMPLEX, 0.42, 1)  # font, size and weight
LEGEND = ("green: free; yellow: costly; red: obstacle", "orange: too near to an obstacle; grey: unknown")
SUN = np.array([-1.0, 1.0, 1.0]) / np.sqrt(3)  # direction of the light in the picture: from the north-west


def layers(elevation: ElevationMap, ground: Traversability) -> dict[str, np.ndarray]:
    """Return the layers of a map, (n, n) [iy, ix] each, by the name of their file.

    Args:
        elevation: The heights.
        ground: What the rover may drive over.
    """
    measured, nan = elevation.measured, np.float32(np.nan)
    valid = _valid(elevation, ground)
    code = np.where(ground.blocked, BLOCKED, np.where(ground.inflated, NEAR, FREE))
    return {
        "elevation": np.where(measured, elevation.low, nan),
        "top": np.where(measured, elevation.top, nan),
        "weight": np.where(measured, elevation.weight, nan),
        "step": np.where(measured, ground.step, nan),
        "slope_deg": np.where(measured, np.rad2deg(ground.slope), nan).astype(np.float32),
        "roughness": np.where(measured, ground.roughness, nan),
        "cost": np.where(measured, ground.cost, nan),
        "traversability": np.where(valid, code, UNKNOWN).astype(np.uint8),
    }


@dataclass(frozen=True)
class MapWindow:
    """The part of a map that its files show.

    Attributes:
        rows, columns: Cells of the map, from the south and from the west.
        west, south: Its corner in the coordinates of the files [m].
        cell: Edge of a cell [m].
    """

    rows: slice
    columns: slice
    west: float
    south: float
    cell: float

    @property
    def shape(self) -> tuple[int, int]:
        """Number of rows and columns."""
        return self.rows.stop - self.rows.start, self.columns.stop - self.columns.start


def window_of(
    elevation: ElevationMap, ground: Traversability, places: np.ndarray, origin: tuple[float, float] = (0.0, 0.0)
) -> MapWindow:
    """Return the smallest window that shows all that is known, and the places of the cameras.

    Args:
        elevation: The heights.
        ground: What the rover may drive over.
        places: (N, 2) places of the cameras in the world [m].
        origin: Place of the world's origin in the coordinates of the files: east and north [m].
    """
    shown = np.asarray(_valid(elevation, ground))
    cells = np.concatenate([np.argwhere(shown)[:, ::-1], elevation.cell_of(places)])  # ix, iy
    (left, low), (right, high) = cells.min(axis=0), cells.max(axis=0) + 1
    west, south = (
        round(float(a + b + first * elevation.config.cell), 6)
        for a, b, first in zip(elevation.origin, origin, (left, low))
    )
    return MapWindow(slice(int(low), int(high)), slice(int(left), int(right)), west, south, elevation.config.cell)


def write_map(
    out: Path,
    elevation: ElevationMap,
    ground: Traversability,
    window: MapWindow,
    poses: np.ndarray,
    epsg: int | None = None,
    of_rover: bool = False,
) -> None:
    """Write a GeoTIFF for each layer, and map.png.

    Args:
        out: The folder; it is made.
        elevation: The heights.
        ground: What the rover may drive over.
        window: The part of them to write, as of window_of.
        poses: (N, 4, 4) cameras to world.
        epsg: Code of the coordinate system of the files; None: a local frame.
        of_rover: Whether the world is the frame of the rover, x ahead and y left.

    Raises:
        OSError: A file cannot be written; the message names it.
    """
    part = window.rows, window.columns
    north = round(window.south + window.shape[0] * window.cell, 6)
    for name, values in layers(elevation, ground).items():
        nodata = UNKNOWN if values.dtype == np.uint8 else float("nan")
        image = np.flipud(values[part])
        file = encode_geotiff(image, window.west, north, window.cell, nodata, epsg, ROVER_FRAME if of_rover else FRAME)
        write_atomically(out / f"{name}.tif", file)
    cells = elevation.cell_of(poses[:, :2, 3]) - (window.columns.start, window.rows.start)
    picture = map_page(np.flipud(map_picture(elevation, ground)[part]), cells, poses[:, :2, 2], window, of_rover)
    write_atomically(out / "map.png", encode_png(picture[..., ::-1]))


def class_colours(elevation: ElevationMap, ground: Traversability) -> np.ndarray:
    """Return the colour of each cell, which TRAVERSABILITY_TITLE explains: (n, n, 3) uint8 RGB, [iy, ix].

    Args:
        elevation: The heights.
        ground: What the rover may drive over.
    """
    code = layers(elevation, ground)["traversability"]
    share = np.clip(ground.cost / COSTLY, 0, 1)[..., None]
    colours = np.array([90.0, 170, 90]) * (1 - share) + np.array([225.0, 205, 80]) * share
    colours[code == NEAR] = (230, 140, 60)
    colours[code == BLOCKED] = (190, 50, 45)
    colours[code == UNKNOWN] = UNKNOWN_COLOUR
    return colours.astype(np.uint8)


def _valid(elevation: ElevationMap, ground: Traversability) -> np.ndarray:
    return np.asarray(elevation.measured | ground.blocked)


def map_picture(elevation: ElevationMap, ground: Traversability) -> np.ndarray:
    """Return the map as colours, shaded by the heights; TRAVERSABILITY_TITLE explains them.

    Args:
        elevation: The heights.
        ground: What the rover may drive over.

    Returns:
        (n, n, 3) uint8 RGB, [iy, ix].
    """
    colours = class_colours(elevation, ground).astype(float)
    height = np.where(elevation.measured, elevation.top, 0)
    dy, dx = np.gradient(height, elevation.config.cell)
    normal = np.stack([-dx, -dy, np.ones_like(dx)], axis=-1)
    light = np.clip(normal @ SUN / np.linalg.norm(normal, axis=-1) / SUN[2], 0.4, 1.4)
    edge = cv2.erode(elevation.measured.astype(np.uint8), np.ones((3, 3), np.uint8)) == 0  # beside it, heights are none
    colours *= np.where(edge | ~_valid(elevation, ground), 1.0, light)[..., None]
    return np.clip(colours, 0, 255).astype(np.uint8)


def map_page(
    picture: np.ndarray, cameras: np.ndarray, axes: np.ndarray, window: MapWindow, of_rover: bool = False
) -> np.ndarray:
    """Return a picture to look at: enlarged, with coordinates, the cameras, a bar, and what the colours mean.

    Args:
        picture: (h, w, 3) uint8 RGB, north up, a pixel a cell.
        cameras: (N, 2) their cells, counted from the west and from the south.
        axes: (N, 2) east and north of their optical axes, of any length.
        window: What the picture shows.
        of_rover: Whether the world is the frame of the rover, x ahead and y left.

    Returns:
        (h', w', 3) uint8 RGB, at least 600 px wide or high.
    """
    height, width = picture.shape[:2]
    factor = max(1, -(-LEAST // max(height, width)))
    picture = picture.repeat(factor, axis=0).repeat(factor, axis=1)
    below, right = picture.shape[0] + 2 * BORDER, LEFT + picture.shape[1] + 2 * BORDER
    length = max(step for step in BARS if step <= max(BARS[0], width * window.cell / 2))
    end = LEFT + BORDER + round(length / window.cell * factor)
    beside = f"{length:g} m; white: cameras, and where they look"
    wide = max(LEFT + LEGEND_WIDTH, right, end + 12 + cv2.getTextSize(beside, *FONT)[0][0])
    page = np.full((below + STRIP, wide, 3), 255, np.uint8)
    page[:below, LEFT:right] = UNKNOWN_COLOUR
    page[BORDER : below - BORDER, LEFT + BORDER : right - BORDER] = picture
    _draw_axes(page, (LEFT + BORDER, below - BORDER), factor / window.cell, window)
    for (x, y), (east, north) in zip(cameras, axes, strict=True):
        at = int((x + 0.5) * factor) + LEFT + BORDER, int((height - y - 0.5) * factor) + BORDER
        long = float(np.hypot(east, north))
        if long > 0 and len(cameras) <= MOST_ARROWS:
            tip = round(at[0] + ARROW * east / long), round(at[1] - ARROW * north / long)
            for colour, thickness in ((0, 4), (255, 2)):
                cv2.arrowedLine(page, at, tip, (colour,) * 3, thickness, cv2.LINE_AA, tipLength=0.35)
        cv2.circle(page, at, 5, (0, 0, 0), -1, cv2.LINE_AA)
        cv2.circle(page, at, 3, (255, 255, 255), -1, cv2.LINE_AA)
    cv2.rectangle(page, (LEFT + BORDER, below + 44), (end, below + 48), (0, 0, 0), -1)
    _write(page, beside, end + 6, below + 50)
    text = "right: x, ahead of the rover; up: y, left of it [m]" if of_rover else "right: east; up: north [m]"
    for line, words in ((0, text), (2, LEGEND[0]), (3, LEGEND[1])):
        _write(page, words, LEFT, below + 34 + 17 * line)
    return page


def _draw_axes(page: np.ndarray, corner: tuple[int, int], pixels: float, window: MapWindow) -> None:
    """Draw the coordinates of a picture along its lower and its left edge.

    Args:
        page: (h, w, 3) uint8, which is drawn into.
        corner: Column and row of the picture's lower left corner [px].
        pixels: Pixels a metre.
        window: What the picture shows.
    """
    step = next((step for step in BARS if step * pixels >= TICK_GAP), BARS[-1])
    for axis, (start, cells) in enumerate(((window.west, window.shape[1]), (window.south, window.shape[0]))):
        first, last = int(np.ceil(start / step - 1e-6)), int(np.floor((start + cells * window.cell) / step + 1e-6))
        for number in range(first, last + 1):
            at = round((number * step - start) * pixels)
            text = f"{round(number * step, 1):.10g}"
            length = cv2.getTextSize(text, *FONT)[0][0]
            if axis == 0:
                x = corner[0] + at
                cv2.line(page, (x, corner[1]), (x, corner[1] + BORDER), (0, 0, 0), 1)
                _write(page, text, min(max(x - length // 2, 0), page.shape[1] - length), corner[1] + BORDER + 14)
            else:
                y = corner[1] - at
                cv2.line(page, (corner[0] - BORDER, y), (corner[0], y), (0, 0, 0), 1)
                _write(page, text, max(LEFT - 4 - length, 0), min(max(y + 4, 10), corner[1]))


def _write(page: np.ndarray, text: str, x: int, y: int) -> None:
    font, size, weight = FONT
    cv2.putText(page, text, (x, y), font, size, (30, 30, 30), weight, cv2.LINE_AA)
