"""Images of missions, in PDS3, VICAR and PDS4, read by `pdr` (the extra `real`)."""

from __future__ import annotations

import warnings
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from marssim.base.calibration.product_label import ProductLabel

EXTRA = 'pip install "mars-m3depth[real]"'


def read_product(path: Path, label: ProductLabel) -> tuple[np.ndarray, np.ndarray]:
    """Read the image of a product.

    Companded images, of 8 bits, stay as they are: what is brighter stays brighter, and stereo needs no more.

    Args:
        path: The product, or its detached label.
        label: Its label.

    Returns:
        (H, W) or (H, W, 3) image, uint8, uint16 or float32, 0 where it holds no data, and (H, W) bool, where it does.

    Raises:
        ImportError: pdr is not installed; the message names the extra.
        ValueError: The file is truncated, or no image. One line that names it.
    """
    has = path.stat().st_size
    if label.file_bytes is not None and has < label.file_bytes:
        raise ValueError(f"{path}: is truncated: it has {has} of {label.file_bytes} bytes; fetch it again")
    if find_spec("pdr") is None:
        raise ImportError(f"{path}: products of PDS need pdr, which is not installed; {EXTRA}")
    raw = _read(path)
    missing = ~np.isfinite(raw)
    for value in label.missing:
        missing |= raw == value
    values = _native(np.where(missing, raw.dtype.type(0), raw))  # the type of the rest, whatever the constant is
    valid = np.asarray(~missing if values.ndim == 2 else ~missing.all(axis=2))
    if label.size is not None and valid.shape != label.size[::-1]:
        raise ValueError(
            f"{path}: the image is {valid.shape[1]} x {valid.shape[0]} px, "
            f"its label says {label.size[0]} x {label.size[1]}"
        )
    return values, valid


def _read(path: Path) -> np.ndarray:
    """Return the first image of a product as (H, W) or (H, W, 3)."""
    import pdr

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            data: Any = pdr.read(str(path))
            for key in sorted(data.keys(), key=lambda key: "IMAGE" not in key.upper()):
                values = data[key]
                if isinstance(values, np.ndarray) and values.ndim in (2, 3) and min(values.shape[-2:]) > 1:
                    break
            else:
                raise ValueError("it holds no image")
    except Exception as error:  # pdr raises whatever its readers meet in a broken file
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise ValueError(f"{path}: is not readable as a product of PDS: {reason}") from None
    if values.ndim == 2:
        return values
    bands = values if values.shape[0] in (1, 3) else np.moveaxis(values, -1, 0)
    if bands.shape[0] not in (1, 3):
        raise ValueError(f"{path}: has {bands.shape[0]} bands; images have 1 or 3")
    return bands[0] if bands.shape[0] == 1 else np.moveaxis(bands, 0, -1)


def _native(values: np.ndarray) -> np.ndarray:
    """Return an image as uint8, uint16 or float32 in the machine's byte order; negative integers become 0."""
    if values.dtype == np.uint8:
        return np.ascontiguousarray(values)
    if values.dtype.kind in "iu":
        low, high = int(values.min()), int(values.max())
        if high <= 65535 and low >= -32768:
            return np.clip(values, 0, 65535).astype(np.uint16)
    return values.astype(np.float32)
