"""The tags of a GeoTIFF about its cells: their size, their order, and the heights that their values stand for."""

from __future__ import annotations

import math
import re
import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
from PIL import TiffImagePlugin

PIXEL_SCALE, TIE_POINT, TRANSFORMATION, GEO_KEYS = 33550, 33922, 34264, 34735  # tags of GeoTIFF
GDAL_ITEMS, NO_DATA = 42112, 42113  # tags of GDAL
MODEL_TYPE, GEOGRAPHIC, LINEAR_UNIT, METRE = 1024, 2, 3076, 9001  # keys of GeoTIFF and their values
LIKE = 1e-3  # share by which the sides of a square cell may differ, or its rows be turned
NOT_SQUARE = 0.01  # share by which the sides of cells in degrees may differ on the ground


@dataclass(frozen=True)
class GeoTags:
    """What the tags of a GeoTIFF say.

    Attributes:
        cell: Side of a cell [m]; None if they do not say.
        south_first: Whether the first row is the southern edge, not the northern one.
        east_first: Whether the first column is the eastern edge, not the western one.
        nodata: Value of cells without data; None for none.
        scale, offset: The height of a value is scale * value + offset.
    """

    cell: float | None = None
    south_first: bool = False
    east_first: bool = False
    nodata: float | None = None
    scale: float = 1.0
    offset: float = 0.0


def read_geotiff_tags(path: str, name: str, scale_field: str, has_scale: bool) -> GeoTags:
    """Read the tags of a GeoTIFF.

    Args:
        path: The file.
        name: Its name in messages.
        scale_field: Name of the setting that gives the cells' size.
        has_scale: Whether the user gave it, so that tags of a wrong kind do not matter.

    Raises:
        ValueError: The tags cannot be read, or the cells are not square, are turned, or are not measured in metres. One
            line that begins with `name`.
    """
    try:
        with open(path, "rb") as file, warnings.catch_warnings(action="ignore"):  # the caller reports a broken file
            header = file.read(8)
            if header[2:4] == b"\x00+":
                raise ValueError("it is a big-endian BigTIFF: save it as little-endian")
            if header[2:4] == b"+\x00":  # BigTIFF
                header += file.read(8)
            tags = TiffImagePlugin.ImageFileDirectory_v2(header)
            file.seek(tags.next)
            tags.load(file)
            named = {
                tag: tags.get(tag) for tag in (PIXEL_SCALE, TIE_POINT, TRANSFORMATION, GEO_KEYS, GDAL_ITEMS, NO_DATA)
            }
            rows = int(tags.get(TiffImagePlugin.IMAGELENGTH, 0))
    except Exception as error:  # a broken directory may raise anything in the reader
        raise ValueError(f"{name}: its tags cannot be read ({error})") from None
    if not has_scale:
        _check_kinds(named, name)
    east, north = _steps(named, name)
    _check_cells(named, rows, east, north, name, scale_field, has_scale)
    items = str(named[GDAL_ITEMS] or "")
    try:
        nodata = None if named[NO_DATA] is None else float(str(named[NO_DATA]).strip(" \0"))
    except ValueError:
        raise ValueError(f"{name}: its nodata tag must be a number, is {named[NO_DATA]!r}") from None
    return GeoTags(
        None if east is None or has_scale else abs(east), (north or -1.0) > 0, (east or 1.0) < 0, nodata,
        _item(items, "scale", 1.0, name), _item(items, "offset", 0.0, name),
    )  # fmt: skip


def _check_kinds(tags: dict[int, Any], name: str) -> None:
    """Raise ValueError for tags that hold something else than the standard says."""
    for tag, what, least in ((GEO_KEYS, "keys", 4), (TRANSFORMATION, "the place of the cells", 16)):
        if tags[tag] is not None and not _are_numbers(tags[tag], least):
            raise ValueError(f"{name}: its tag of {what} ({tag}) must be {least} numbers or more, is {tags[tag]!r:.60}")
    size = tags[PIXEL_SCALE]
    if size is not None and not (_are_numbers(size, 2) and min(size[:2]) > 0):
        wanted = "must be two numbers above 0 or more"
        raise ValueError(f"{name}: its tag of the cells' size ({PIXEL_SCALE}) {wanted}, is {size!r:.60}")


def _steps(tags: dict[int, Any], name: str) -> tuple[float | None, float | None]:
    """Return how far the next column lies to the east and the next row to the north; None if the tags do not say."""
    matrix, size = tags[TRANSFORMATION], tags[PIXEL_SCALE]
    if _are_numbers(matrix, 16):
        east, north = float(matrix[0]), float(matrix[5])
        if max(abs(matrix[1]), abs(matrix[4])) > LIKE * min(abs(east), abs(north)) or 0.0 in (east, north):
            raise ValueError(f"{name}: is turned: its rows do not run along the east; resample it with north up")
        return east, north
    if _are_numbers(size, 2) and min(size[:2]) > 0:
        return float(size[0]), -float(size[1])
    return None, None


def _check_cells(
    tags: dict[int, Any], rows: int, east: float | None, north: float | None, name: str, scale_field: str,
    has_scale: bool,
) -> None:  # fmt: skip
    """Raise ValueError unless the cells are square and in metres, or the user gave their size.

    Args:
        tags: The tags.
        rows: Number of rows.
        east: How far the next column lies to the east; None if the tags do not say.
        north: How far the next row lies to the north.
        name: Name of the file.
        scale_field: Name of the setting that gives the cells' size.
        has_scale: Whether the user gave it.
    """
    keys = tags[GEO_KEYS] if _are_numbers(tags[GEO_KEYS], 4) else ()
    entries = {key: value for key, place, _, value in zip(*[iter(keys[4:])] * 4) if place == 0}
    in_degrees = entries.get(MODEL_TYPE) == GEOGRAPHIC
    if in_degrees and not has_scale:
        raise ValueError(f"{name}: its cells are in degrees; project it, or give {scale_field} [m] near the equator")
    if not in_degrees and not has_scale and entries.get(LINEAR_UNIT, METRE) != METRE:
        raise ValueError(f"{name}: its cells are not measured in metres; give {scale_field} [m]")
    if east is None or north is None:
        return
    share = abs(east / north)
    if not in_degrees:
        if not np.isclose(share, 1, rtol=LIKE):
            raise ValueError(f"{name}: its cells are {abs(east):g} x {abs(north):g}, not square; resample it")
        return
    tie, matrix = tags[TIE_POINT], tags[TRANSFORMATION]
    if not (_are_numbers(matrix, 16) or _are_numbers(tie, 6)):
        return
    first, at = (float(matrix[7]), 0.0) if _are_numbers(matrix, 16) else (float(tie[4]), float(tie[1]))
    latitude = first + (rows / 2 - at) * north
    share *= math.cos(math.radians(latitude))
    if abs(share - 1) > NOT_SQUARE:
        raise ValueError(
            f"{name}: its cells are in degrees, and at {latitude:.0f} deg of latitude {share:.2f} times as wide as "
            "high; project it"
        )


def _item(items: str, role: str, default: float, name: str) -> float:
    """Return a number of the first band in GDAL's XML, by its role; the default if it is not there."""
    for attributes, text in re.findall(r"<Item\s([^<>]*)>([^<]*)</Item>", items):
        if f'role="{role}"' in attributes and ('sample="0"' in attributes or "sample=" not in attributes):
            try:
                value = float(text)
            except ValueError:
                value = math.nan
            if not math.isfinite(value) or (role == "scale" and value == 0):
                wanted = "must be a finite number, not 0" if role == "scale" else "must be a finite number"
                raise ValueError(f"{name}: the {role} of its heights {wanted}, is {text!r:.60}")
            return value
    return default


def _are_numbers(tag: object, least: int) -> bool:
    """Return whether a tag is a tuple of finite numbers, `least` or more."""
    return (
        isinstance(tag, tuple)
        and len(tag) >= least
        and all(isinstance(value, int | float) and math.isfinite(value) for value in tag)
    )
