"""What the pixels of a sample show, by the numbers of its surfaces."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np

from marssim.base.files.json_file import DatasetError

SLABS = ("slabs", "ledges")  # kinds of surface that are plates of bedrock: slabs with beds and chips, blocks of ledges


class SurfaceTruth(Protocol):
    """The fields of a sample that are read; meta may hold "surface_ids", the first and last number of each kind."""

    @property
    def rock(self) -> np.ndarray: ...
    @property
    def meta(self) -> dict[str, Any]: ...


def on_slab(sample: SurfaceTruth) -> np.ndarray:
    """Return the pixels (H, W) bool of slabs and of the blocks of ledges; none where the sample has no surface_ids.

    Raises:
        DatasetError: The surface_ids are malformed.
    """
    ids = getattr(sample, "meta", {}).get("surface_ids")
    slab = np.zeros(sample.rock.shape, bool)
    if ids is None:
        return slab
    for kind in SLABS:
        span = ids.get(kind, []) if isinstance(ids, Mapping) else None
        if not isinstance(span, list) or len(span) not in (0, 2) or not all(type(n) is int for n in span):
            raise DatasetError(f"surface_ids of a sample must hold [first, last] or [] for {kind}, got {ids!r}")
        if span:
            slab |= (sample.rock >= span[0]) & (sample.rock <= span[1])
    return slab
