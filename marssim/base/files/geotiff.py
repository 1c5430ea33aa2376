"""Write GeoTIFF: a map of numbers that knows where it lies, for GIS programs and planners of rovers.

A baseline TIFF (one strip, no compression) with the tags of OGC GeoTIFF 1.1: ModelPixelScale and ModelTiepoint give
the place, GeoKeyDirectory the coordinate system, and GDAL's tag the value of cells without data.
"""

from __future__ import annotations

import struct

import numpy as np

SAMPLE = {"u1": 1, "f4": 3}  # TIFF's SampleFormat by NumPy's type: unsigned integers, floats
SHORT, LONG, DOUBLE, ASCII = 3, 4, 12, 2  # types of a field
SIZES = {SHORT: ("H", 2), LONG: ("I", 4), DOUBLE: ("d", 8), ASCII: ("c", 1)}
FRAME = "local frame: x east, y north, metres"


def encode_geotiff(
    values: np.ndarray, west: float, north: float, cell: float, nodata: float, epsg: int | None = None,
    frame: str = FRAME,
) -> bytes:  # fmt: skip
    """Encode a map as GeoTIFF.

    Args:
        values: (H, W) uint8 or float32, with the north in its first row and the west in its first column.
        west: x of the map's left edge [m].
        north: y of its upper edge [m].
        cell: Edge of a cell [m].
        nodata: Value of cells without data; it may be NaN.
        epsg: Code of the projected coordinate system in metres; None: a local frame.
        frame: What the local frame is, in words.

    Returns:
        The content of the file.

    Raises:
        ValueError: The map has another shape or type.
    """
    kind = values.dtype.str[1:]
    if values.ndim != 2 or kind not in SAMPLE:
        raise ValueError(f"a GeoTIFF holds a map (H, W) of uint8 or float32, got {values.dtype} {values.shape}")
    height, width = values.shape
    pixels = np.ascontiguousarray(values, f"<{kind}").tobytes()
    place, name = [(1025, 0, 1, 1)], f"{frame}|"  # a pixel is an area
    if epsg is None:
        place += [(1026, 34737, len(name), 0), (3072, 0, 1, 32767), (3076, 0, 1, 9001)]  # user-defined, metre
    else:
        place += [(3072, 0, 1, epsg)]
    keys = [(1, 1, 0, len(place) + 1), (1024, 0, 1, 1), *place]  # 1024: projected coordinates
    fields: list[tuple[int, int, list[int] | list[float] | bytes]] = [
        (256, LONG, [width]),
        (257, LONG, [height]),
        (258, SHORT, [8 * values.itemsize]),
        (259, SHORT, [1]),  # no compression
        (262, SHORT, [1]),  # 0 is black
        (273, LONG, [8]),  # the strip follows the header
        (277, SHORT, [1]),
        (278, LONG, [height]),
        (279, LONG, [len(pixels)]),
        (339, SHORT, [SAMPLE[kind]]),
        (33550, DOUBLE, [cell, cell, 0.0]),
        (33922, DOUBLE, [0.0, 0.0, 0.0, west, north, 0.0]),
        (34735, SHORT, [number for key in keys for number in key]),
        *([(34737, ASCII, name.encode() + b"\0")] if epsg is None else []),
        (42113, ASCII, (b"nan" if np.isnan(nodata) else f"{nodata:g}".encode()) + b"\0"),
    ]
    directory = 8 + len(pixels) + len(pixels) % 2
    return b"II*\0" + struct.pack("<I", directory) + pixels + b"\0" * (len(pixels) % 2) + _directory(fields, directory)


def _directory(fields: list[tuple[int, int, list[int] | list[float] | bytes]], start: int) -> bytes:
    """Return an image file directory, and behind it the values that do not fit into its entries.

    Args:
        fields: Tag, type and values of each, by rising tags.
        start: Place of the directory in the file.
    """
    behind = start + 2 + 12 * len(fields) + 4
    entries, values_behind = b"", b""
    for tag, kind, values in fields:
        letter, size = SIZES[kind]
        data = values if isinstance(values, bytes) else struct.pack(f"<{len(values)}{letter}", *values)
        count = len(data) // size
        if len(data) > 4:
            entry = struct.pack("<I", behind + len(values_behind))
            values_behind += data + b"\0" * (len(data) % 2)
        else:
            entry = data.ljust(4, b"\0")
        entries += struct.pack("<HHI", tag, kind, count) + entry
    return struct.pack("<H", len(fields)) + entries + b"\0\0\0\0" + values_behind
