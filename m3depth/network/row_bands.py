"""Parts of the network whose rows do not depend on each other, computed in bands of rows that stay in a core's cache.

On large images, sums and products of whole maps wait for the main memory: bands are up to five times as fast. A GPU
computes large maps whole, since the start of each operation takes it longer than a small band.
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

BAND_ON_CPU = 200_000  # most numbers of a band's inputs on a CPU, so that they stay in a core's cache (float32: 0.8 MB)
BAND_ON_GPU = 64_000_000  # most of them on a GPU, so that they take a small part of its memory (float32: 256 MB)


def by_rows(part: Callable[..., Tensor], *maps: Tensor) -> Tensor:
    """Return part(*maps), computed in bands of rows where nothing is trained or exported.

    Args:
        part: Takes maps (..., h, W) of some rows, and returns one (..., k h, w), the same for every split of the rows.
        maps: (..., H, W) each.
    """
    height = maps[0].shape[-2]
    most = BAND_ON_CPU if maps[0].device.type == "cpu" else BAND_ON_GPU
    rows = max(1, most * height // max(1, sum(x.numel() for x in maps)))
    if rows >= height or torch.is_grad_enabled() or torch.jit.is_tracing():
        return part(*maps)
    starts = range(0, height, rows)
    return torch.cat([part(*(x[..., first : first + rows, :] for x in maps)) for first in starts], -2)
