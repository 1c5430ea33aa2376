"""The files of a map: GeoTIFF layers that planners and GIS programs read, and a picture to look at."""

from __future__ import annotations

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
LEAST = 400  # [px] side of the picture from which on a cell is one pixel
SUN = np.array([-1.0, 1.0, 1.0]) / np.sqrt(3)  # direction of the light in the picture: from the north-west


def layers(elevation: ElevationMap, ground: Traversability) -> dict[str, np.ndarray]:
    """Return the layers of a map, (n, n) [iy, ix] each, by the name of their file.

    Args:
        elevation: The heights.
        ground: What the rover may drive over.
    """
    measured, nan = elevation.measured, np.float32(np.nan)
    known = _known(elevation, ground)
    code = np.where(ground.blocked, BLOCKED, np.where(ground.inflated, NEAR, FREE))
    return {
        "elevation": np.where(measured, elevation.low, nan),
        "top": np.where(measured, elevation.top, nan),
        "step": np.where(measured, ground.step, nan),
        "slope_deg": np.where(measured, np.rad2deg(ground.slope), nan).astype(np.float32),
        "roughness": np.where(measured, ground.roughness, nan),
        "cost": np.where(measured, ground.cost, nan),
        "traversability": np.where(known, code, UNKNOWN).astype(np.uint8),
    }


def write_map(
    out: Path,
    elevation: ElevationMap,
    ground: Traversability,
    origin: tuple[float, float] = (0.0, 0.0),
    epsg: int | None = None,
) -> None:
    """Write a GeoTIFF for each layer, and map.png.

    Args:
        out: The folder; it is made.
        elevation: The heights.
        ground: What the rover may drive over.
        origin: Place of the world's origin in the coordinates of the files: east and north [m].
        epsg: Code of the coordinate system of the files; None: a local frame.

    Raises:
        OSError: A file cannot be written; the message names it.
    """
    cell = elevation.config.cell
    west, south = (float(a + b) for a, b in zip(elevation.origin, origin))
    west, north = round(west, 6), round(south + elevation.n * cell, 6)
    for name, values in layers(elevation, ground).items():
        nodata = UNKNOWN if values.dtype == np.uint8 else float("nan")
        write_atomically(out / f"{name}.tif", encode_geotiff(np.flipud(values), west, north, cell, nodata, epsg))
    write_atomically(out / "map.png", encode_png(map_picture(elevation, ground)[..., ::-1]))


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


def _known(elevation: ElevationMap, ground: Traversability) -> np.ndarray:
    return np.asarray(elevation.measured | ground.blocked)


def map_picture(elevation: ElevationMap, ground: Traversability) -> np.ndarray:
    """Return the map as colours, north up, shaded by the heights; TRAVERSABILITY_TITLE explains them.

    Args:
        elevation: The heights.
        ground: What the rover may drive over.

    Returns:
        (h, w, 3) uint8 RGB, at least 400 px wide.
    """
    colours = class_colours(elevation, ground).astype(float)
    height = np.where(elevation.measured, elevation.top, 0)
    dy, dx = np.gradient(height, elevation.config.cell)
    normal = np.stack([-dx, -dy, np.ones_like(dx)], axis=-1)
    light = np.clip(normal @ SUN / np.linalg.norm(normal, axis=-1) / SUN[2], 0.4, 1.4)
    edge = cv2.erode(elevation.measured.astype(np.uint8), np.ones((3, 3), np.uint8)) == 0  # beside it, heights are none
    colours *= np.where(edge | ~_known(elevation, ground), 1.0, light)[..., None]
    picture = np.flipud(np.clip(colours, 0, 255).astype(np.uint8))
    factor = max(1, -(-LEAST // elevation.n))
    return np.ascontiguousarray(picture.repeat(factor, axis=0).repeat(factor, axis=1))
