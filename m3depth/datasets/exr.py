"""Channels of OpenEXR files."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import numpy as np


def exr_channels(path: Path) -> dict[str, np.ndarray]:
    """Read the channels of an EXR file, (H, W) float32 each, by the last part of their names in capitals.

    Args:
        path: The file. The channel V of its layer Depth, "Depth.V", is "V".

    Raises:
        ImportError: OpenEXR is not installed; the message names the extra.
        ValueError: The file cannot be read.
    """
    if find_spec("OpenEXR") is None:
        raise ImportError(f"{path}: OpenEXR is not installed; pip install 'mars-m3depth[exr]'")
    import OpenEXR

    try:
        channels = OpenEXR.File(str(path), separate_channels=True).channels()
    except RuntimeError as error:
        raise ValueError(str(error)) from None
    return {name.rsplit(".")[-1].upper(): np.asarray(channel.pixels, np.float32) for name, channel in channels.items()}
