"""Read a map that nav.map wrote, as heights that are known before a drive: Navigator(prior=read_map("out/map"))."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from marssim.base.files.decoding import decode
from marssim.base.files.json_file import DatasetError, read_json
from nav.ground.elevation import FEWEST_CELLS, ElevationConfig, ElevationMap
from nav.ground.map_files import MOST_CELLS, RESULT

REMAKE = "make the map again with nav.map"
LAYER_FILES = {"top": "top", "low": "elevation", "weight": "weight"}  # by the layer of an ElevationMap


def read_map(folder: Path | str) -> ElevationMap:
    """Return the map in a folder of nav.map, with the heights and weights of the cells that were seen.

    It lies in the world of the poses that it was made of, whatever --origin was; a map of a single pair without a pose
    lies in that rover's frame. Possible drops in hidden ground are not in the files.

    Args:
        folder: What --out of nav.map was.

    Raises:
        DatasetError: There is no map in the folder, or a file of it is broken; the message, one line, names it.
    """
    folder = Path(folder)
    if not (folder / RESULT).is_file():
        raise DatasetError(f"{folder}: holds no {RESULT}; give a folder that nav.map wrote")
    cell, (rows, columns), corner = _place(folder / RESULT)
    size = max(rows, columns, FEWEST_CELLS) * cell
    elevation = ElevationMap(ElevationConfig(cell=cell, size=size))
    elevation.origin = corner
    for name, file in LAYER_FILES.items():
        getattr(elevation, name)[:rows, :columns] = np.flipud(_layer(folder / f"{file}.tif", (rows, columns)))
    measured = np.isfinite(elevation.top) & np.isfinite(elevation.low) & (elevation.weight > 0)
    elevation.top[~measured], elevation.low[~measured], elevation.weight[~measured] = np.nan, np.nan, 0
    return elevation


def is_of_rover(folder: Path) -> bool:
    """Return whether the map in a folder of nav.map lies in a rover's frame, since its pair had no pose."""
    return read_json(folder / RESULT).get("frame") == "rover"


def _place(file: Path) -> tuple[float, tuple[int, int], np.ndarray]:
    """Return the edge of a cell [m], the number of rows and columns, and the corner in the world of the poses [m]."""
    content = read_json(file)
    if "origin_m" not in content:
        raise DatasetError(f"{file}: field 'origin_m' is missing; {REMAKE}")
    cell = _numbers(file, content, "cell_m", 1)[0]
    rows, columns = _numbers(file, content, "rows_columns", 2)
    if not 0 < cell <= 10:
        raise DatasetError(f"{file}: cell_m must be over 0 and up to 10 m, got {cell:g}")
    if not all(1 <= n <= MOST_CELLS and n == int(n) for n in (rows, columns)):
        raise DatasetError(
            f"{file}: rows_columns must be two whole numbers of 1 to {MOST_CELLS}, got {rows:g} {columns:g}"
        )
    corner = np.subtract(_numbers(file, content, "west_south_m", 2), _numbers(file, content, "origin_m", 2))
    return cell, (int(rows), int(columns)), corner


def _numbers(file: Path, content: dict[str, Any], name: str, count: int) -> list[float]:
    value = content.get(name)
    numbers: list[Any] = value if isinstance(value, list) else [value]
    usual = all(isinstance(n, int | float) and not isinstance(n, bool) for n in numbers)
    if len(numbers) != count or not usual or not all(map(math.isfinite, numbers)):
        wanted = "a finite number" if count == 1 else f"{count} finite numbers"
        raise DatasetError(f"{file}: {name} must be {wanted}, got {value!r:.40}")
    return [float(n) for n in numbers]


def _layer(file: Path, shape: tuple[int, int]) -> np.ndarray:
    """Return the numbers of a layer, (rows, columns) float32, with the north in its first row."""
    if not file.is_file():
        raise DatasetError(f"{file}: no such file; {REMAKE}")
    try:
        values = decode(file.read_bytes())
    except ValueError:
        values = None
    if values is None or values.dtype != np.float32:
        raise DatasetError(f"{file}: is no layer of a map; {REMAKE}")
    if values.shape != shape:
        raise DatasetError(f"{file}: has {values.shape} cells, {RESULT} beside it says {shape}; {REMAKE}")
    return np.asarray(values)
