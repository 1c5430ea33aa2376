"""Maps of one prediction in the file types that other programs read, and their values where a map knows nothing.

npy     float32 as it is: NaN is unknown
tiff    float32 likewise
pfm     float32; unknown is inf, since readers of PFM refuse NaN
png     16 bits: depth in mm, 256 times the disparity, 65535 times the confidence; 0 is unknown, sky, or beyond
        65535; normals as normal_colours shows them, in 16 bits: red (1 + x) / 2 * 65535, green of -y and blue of -z
        likewise, black where there is none
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import cv2
import numpy as np

from marssim.base.dataset.encoding import decode_normal, encode_normal
from marssim.base.files.decoding import decode
from marssim.base.files.npy import encode_npy, read_npy
from marssim.base.files.pfm import decode_pfm, encode_pfm
from marssim.base.files.png import decode_png, encode_png

MapKind = Literal["depth", "disparity", "normal", "confidence"]
MapFormat = Literal["npy", "png", "tiff", "pfm"]
MAP_KINDS: tuple[MapKind, ...] = ("depth", "disparity", "normal", "confidence")
MAP_FORMATS: tuple[MapFormat, ...] = ("npy", "tiff", "pfm", "png")  # in the order in which they are looked for
PNG_UNIT: dict[MapKind, float] = {"depth": 1000.0, "disparity": 256.0, "confidence": 65535.0}
"""What a PNG stores for 1 m, for 1 px (as KITTI does) and for a confidence of 1."""
SHOWN = np.array([1, -1, -1], np.float32)  # red right, green up, blue to the camera
QUICK = [cv2.IMWRITE_PNG_COMPRESSION, 1]  # a third of the time of OpenCV's default, 5 % larger


def encode_map(values: np.ndarray, kind: MapKind, form: MapFormat) -> bytes:
    """Encode a map.

    Args:
        values: (H, W) float32, or (H, W, 3) for normals.
        kind: What it holds.
        form: Type of the file.

    Returns:
        The content of the file.
    """
    if form == "npy":
        return encode_npy(values)
    if form == "pfm":
        return encode_pfm(np.where(np.isnan(values), np.float32(np.inf), values))
    if form == "tiff":
        stored = values[..., ::-1] if values.ndim == 3 else values
        return cv2.imencode(".tiff", np.ascontiguousarray(stored, np.float32))[1].tobytes()
    if kind == "normal":
        return encode_png(_normal_code(values)[..., ::-1], QUICK)
    return encode_png(_uint16(values * np.float32(PNG_UNIT[kind])), QUICK)


def find_map(folder: Path, kind: MapKind) -> Path | None:
    """Return the file of a map in a folder, of the most exact type that is there; None if there is none."""
    return next((path for form in MAP_FORMATS if (path := folder / f"{kind}.{form}").is_file()), None)


def read_map_file(path: Path, kind: MapKind) -> np.ndarray:
    """Read a map that encode_map wrote.

    Args:
        path: The file; its suffix tells the type.
        kind: What it holds.

    Returns:
        (H, W) or (H, W, 3) float32. What a PNG holds as 0 is NaN, but in maps of confidence, and so is what a PFM holds
        as inf: both mark what is unknown and what is sky alike.

    Raises:
        ValueError: The file is broken or holds something else; the message names it.
    """
    form = path.suffix[1:]
    try:
        if form == "npy":
            values: np.ndarray | None = read_npy(path)
        elif form == "pfm":
            values = decode_pfm(path.read_bytes())
        elif form == "png":
            values = decode_png(path.read_bytes())
        else:
            values = decode(path.read_bytes())
    except ValueError:
        values = None
    if values is None or values.ndim != (3 if kind == "normal" else 2) or values.dtype.kind not in "fu":
        raise ValueError(f"{path}: is not a map of {kind}")
    if values.ndim == 3 and form in ("tiff", "png"):
        values = np.ascontiguousarray(values[..., ::-1])
    if form == "pfm":
        return np.where(np.isinf(values), np.float32(np.nan), values).astype(np.float32)
    if form != "png":
        return np.asarray(values, np.float32)
    if kind == "normal":
        return decode_normal(values) * SHOWN
    unknown = np.float32(0 if kind == "confidence" else np.nan)
    return np.where(values > 0, values.astype(np.float32) / np.float32(PNG_UNIT[kind]), unknown)


def _normal_code(normal: np.ndarray) -> np.ndarray:
    """Return normals (H, W, 3) as uint16 colours; black where there is none."""
    valid = np.isfinite(normal).all(axis=-1, keepdims=True)
    return encode_normal(np.where(valid, normal, np.float32(0)) * SHOWN)


def _uint16(values: np.ndarray) -> np.ndarray:
    """Return rounded values; 0 where a value is not finite or does not fit."""
    with np.errstate(invalid="ignore"):
        fits = np.isfinite(values) & (values >= 0) & (values < 65535.5)
    return np.round(np.where(fits, values, 0)).astype(np.uint16)
