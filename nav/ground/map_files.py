"""The files of a map: GeoTIFF layers that planners and GIS programs read, and a picture to look at."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from marssim.base.files.atomic import write_atomically
from marssim.base.files.geotiff import encode_geotiff
from marssim.base.files.png import encode_png
from nav.ground.elevation import ElevationMap
from nav.ground.traversability import Traversability

FREE, NEAR, BLOCKED, UNKNOWN = 0, 1, 2, 255  # values of traversability.tif
COSTLY = 4.0  # extra cost of a metre at which free ground is drawn yellow
UNKNOWN_COLOUR = (128, 128, 128)
TRAVERSABILITY_TITLE = "green free, yellow costly, orange too near to an obstacle, red obstacle, grey unknown"
LEAST = 600  # [px] longer side of the picture from which on a cell is one pixel
LEGEND_WIDTH = 340  # [px]
BORDER = 6  # [px] around the picture, for cameras at its edge
STRIP = 56  # [px] height of what is written below the picture
BARS = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100)  # [m] lengths of the bar
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
        "step": np.where(measured, ground.step, nan),
        "slope_deg": np.where(measured, np.rad2deg(ground.slope), nan).astype(np.float32),
        "roughness": np.where(measured, ground.roughness, nan),
        "cost": np.where(measured, ground.cost, nan),
        "traversability": np.where(valid, code, UNKNOWN).astype(np.uint8),
    }


@dataclass(frozen=True)
class Window:
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
) -> Window:
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
    return Window(slice(int(low), int(high)), slice(int(left), int(right)), west, south, elevation.config.cell)


def write_map(
    out: Path,
    elevation: ElevationMap,
    ground: Traversability,
    window: Window,
    places: np.ndarray,
    epsg: int | None = None,
) -> None:
    """Write a GeoTIFF for each layer, and map.png.

    Args:
        out: The folder; it is made.
        elevation: The heights.
        ground: What the rover may drive over.
        window: The part of them to write, as of window_of.
        places: (N, 2) places of the cameras in the world [m].
        epsg: Code of the coordinate system of the files; None: a local frame.

    Raises:
        OSError: A file cannot be written; the message names it.
    """
    part = window.rows, window.columns
    north = round(window.south + window.shape[0] * window.cell, 6)
    for name, values in layers(elevation, ground).items():
        nodata = UNKNOWN if values.dtype == np.uint8 else float("nan")
        image = np.flipud(values[part])
        write_atomically(out / f"{name}.tif", encode_geotiff(image, window.west, north, window.cell, nodata, epsg))
    cells = elevation.cell_of(places) - (window.columns.start, window.rows.start)
    picture = map_page(np.flipud(map_picture(elevation, ground)[part]), cells, window.cell)
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


def map_page(picture: np.ndarray, cameras: np.ndarray, cell: float) -> np.ndarray:
    """Return a picture to look at: enlarged, with the cameras, a bar of a round length, and what the colours mean.

    Args:
        picture: (h, w, 3) uint8 RGB, north up, a pixel a cell.
        cameras: (N, 2) their cells, counted from the west and from the south.
        cell: Edge of a cell [m].

    Returns:
        (h', w', 3) uint8 RGB, at least 600 px wide or high.
    """
    height, width = picture.shape[:2]
    factor = max(1, -(-LEAST // max(height, width)))
    picture = picture.repeat(factor, axis=0).repeat(factor, axis=1)
    below, across = picture.shape[0] + 2 * BORDER, picture.shape[1] + 2 * BORDER
    page = np.full((below + STRIP, max(LEGEND_WIDTH, across), 3), 255, np.uint8)
    page[:below, :across] = UNKNOWN_COLOUR
    page[BORDER : below - BORDER, BORDER : across - BORDER] = picture
    for x, y in cameras:
        at = int((x + 0.5) * factor) + BORDER, int((height - y - 0.5) * factor) + BORDER
        cv2.circle(page, at, 5, (0, 0, 0), -1, cv2.LINE_AA)
        cv2.circle(page, at, 3, (255, 255, 255), -1, cv2.LINE_AA)
    length = max(step for step in BARS if step <= max(BARS[0], width * cell / 2))
    end = 6 + round(length / cell * factor)
    cv2.rectangle(page, (6, below + 8), (end, below + 12), (0, 0, 0), -1)
    _write(page, f"{length:g} m; white: cameras", end + 6, below + 14)
    for line, text in enumerate(LEGEND):
        _write(page, text, 6, below + 32 + 16 * line)
    return page


def _write(page: np.ndarray, text: str, x: int, y: int) -> None:
    cv2.putText(page, text, (x, y), cv2.FONT_HERSHEY_SIMPLEX, 0.42, (30, 30, 30), 1, cv2.LINE_AA)
