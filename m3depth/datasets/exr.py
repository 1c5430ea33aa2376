"""Layers and channels of OpenEXR files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from marssim.base.files.json_file import DatasetError

Layer = Mapping[str, np.ndarray]
"""The channels of a layer by the last part of their names, in capitals: V of Depth.V. (H, W) float32 each."""


def exr_layers(path: Path) -> dict[str, Layer]:
    """Read an EXR file, as the channels of each layer by its name; that of channels without a layer is "".

    Raises:
        ImportError: OpenEXR is not installed; the message names the extra.
        ValueError: The file cannot be read.
    """
    if find_spec("OpenEXR") is None:
        raise ImportError(f'{path}: OpenEXR is not installed; pip install "mars-m3depth[exr]"')
    import OpenEXR

    try:
        channels = OpenEXR.File(str(path), separate_channels=True).channels()
    except RuntimeError as error:
        raise ValueError(str(error)) from None
    layers: dict[str, dict[str, np.ndarray]] = {}
    for name, channel in channels.items():
        layer, _, last = name.rpartition(".")
        layers.setdefault(layer, {})[last.upper()] = np.asarray(channel.pixels, np.float32)
    return dict(layers)


def only_layer(path: Path, layers: Mapping[str, Layer], kind: str, fits: Callable[[Layer], bool]) -> Layer | None:
    """Return the layer that holds a map: one that its name tells, else the channels without a layer, else the only one.

    Args:
        path: The file, for messages.
        layers: As of exr_layers.
        kind: What the map holds, which is part of the name of a layer that tells it.
        fits: Returns whether channels can be those of such a map.

    Returns:
        None if no layer fits.

    Raises:
        DatasetError: Several layers fit, and their names do not tell which it is; the message names them.
    """
    fitting = {name: channels for name, channels in layers.items() if fits(channels)}
    named = {name: channels for name, channels in fitting.items() if kind in name.lower()}
    plain = {name: channels for name, channels in fitting.items() if not name}
    candidates = named or plain or fitting
    if len(candidates) > 1:
        raise DatasetError(
            f"{path}: {' and '.join(sorted(candidates))} may all hold the {kind}; the name of one layer must tell it"
        )
    return next(iter(candidates.values()), None)
