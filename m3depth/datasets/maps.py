"""Disparity and depth maps in the file types of datasets."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np

from m3depth.datasets.exr import Layer, exr_layers, only_layer
from m3depth.datasets.image_files import decode_image
from marssim.base.dataset.map_file import PNG_UNIT
from marssim.base.files.json_file import DatasetError
from marssim.base.files.npy import read_npy

Kind = Literal["disparity", "depth"]
UNITS: dict[Kind, str] = {"disparity": "px", "depth": "m"}
FAR = 1000.0  # [m] beyond this is sky; renderers write about 1e10 where there is no surface
DEPTH_CHANNELS = ("Z", "V", "R", "Y")  # of an EXR file's layer, the first that exists; OAISYS repeats one channel


def read_map(path: Path, kind: Kind, unit: float | None = None, zero_is_far: bool = False) -> np.ndarray:
    """Read a map of disparity [px] or depth [m].

    Disparity that is not finite or under 0 is unknown, and 0 too unless zero_is_far. Depth that is NaN, 0 or negative
    is unknown; depth of 1 km and more is sky. An infinite depth of a PFM file is unknown: such files mark it so.

    Args:
        path: The file: npy, exr, or an image that OpenCV reads.
        kind: "disparity" or "depth".
        unit: Stored number that stands for 1 px or 1 m; None is 256 or 1000 in a PNG and 1 elsewhere.
        zero_is_far: A disparity of 0 is sky, not a gap.

    Returns:
        (H, W) float32, NaN where unknown; sky has disparity 0 or depth inf.

    Raises:
        DatasetError: The file is missing, unreadable, of channels that differ, of several EXR layers whose names do not
            tell which is the depth, or a PNG of 8 bits without a unit; the message names it.
        ImportError: An EXR file without OpenEXR; the message names the extra.
    """
    stored = _numbers(path)
    is_png = path.suffix.lower() == ".png"
    if is_png and unit is None and stored.dtype == np.uint8:
        raise DatasetError(
            f"{path}: has 8 bits; a PNG of {kind} has 16 bits, {PNG_UNIT[kind]:g} for 1 {UNITS[kind]}, unless the "
            "layout takes --unit"
        )
    values = stored.astype(np.float32) / np.float32(unit or (PNG_UNIT[kind] if is_png else 1.0))
    with np.errstate(invalid="ignore"):
        if kind == "depth":
            if path.suffix.lower() == ".pfm":
                values = np.where(np.isinf(values), np.float32(np.nan), values)
            return np.where(values >= FAR, np.float32(np.inf), np.where(values > 0, values, np.float32(np.nan)))
        valid = np.isfinite(values) & ((values >= 0) if zero_is_far else (values > 0))
    return np.where(valid, values, np.float32(np.nan))


def read_mask(path: Path) -> np.ndarray:
    """Read a mask, (H, W) uint8. Raises DatasetError that names the file."""
    values = _numbers(path)
    if values.dtype != np.uint8:
        raise DatasetError(f"{path}: holds {values.dtype}; a mask must have 8 bits")
    return values


def _numbers(path: Path) -> np.ndarray:
    """Read the stored numbers, (H, W); one of several equal channels."""
    if not path.is_file():
        raise DatasetError(f"{path}: no such file")
    values: np.ndarray | None
    try:
        if path.suffix.lower() == ".npy":
            values = read_npy(path).squeeze()
        elif path.suffix.lower() == ".exr":
            values = _exr(path)
        else:
            values = decode_image(path.read_bytes())
    except ValueError as error:
        if isinstance(error, DatasetError):
            raise
        values = None
    if values is None or values.dtype.kind not in "fiu" or values.ndim not in (2, 3):
        raise DatasetError(f"{path}: holds no map that can be read")
    if values.ndim == 2:
        return values
    is_image = path.suffix.lower() not in (".npy", ".exr")
    return _only_channel(path, values[..., :3] if is_image else values)  # the fourth one of an image is alpha


def _only_channel(path: Path, values: np.ndarray) -> np.ndarray:
    """Return the first of equal channels (H, W, C). Raises DatasetError that names the file where they differ."""
    first = values[..., :1]
    if not np.array_equal(values, np.broadcast_to(first, values.shape), equal_nan=values.dtype.kind == "f"):
        raise DatasetError(f"{path}: has {values.shape[2]} channels that differ; it must hold one number a pixel")
    return np.ascontiguousarray(first[..., 0])


def _exr(path: Path) -> np.ndarray:
    channels = only_layer(path, exr_layers(path), "depth", _may_be_depth)
    if channels is None:
        raise ValueError("no depth channel")
    chosen = next(name for name in DEPTH_CHANNELS if name in channels)
    if chosen == "R":  # of a picture, whose channels repeat the depth
        return np.dstack([channels[name] for name in "RGB" if name in channels])
    return channels[chosen]


def _may_be_depth(channels: Layer) -> bool:
    return not channels.keys().isdisjoint(DEPTH_CHANNELS) and not {"X", "Y", "Z"} <= channels.keys()
