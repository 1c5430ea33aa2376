"""A sheet of samples, to look over a dataset at one glance."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from marssim.base.dataset.sample import StereoSample
from marssim.base.images.colours import depth_colours, normal_colours


def contact_sheet(samples: Sequence[StereoSample], columns: int = 3, tile: int = 192) -> np.ndarray:
    """(H, W, 3) uint8 RGB sheet: left eye, right eye, depth and normals of each sample, with scene and view."""
    cells = []
    for sample in samples:
        parts = [sample.left, sample.right, depth_colours(sample.depth), normal_colours(sample.normal)]
        size = (tile, max(1, round(tile * sample.depth.shape[0] / sample.depth.shape[1])))
        cell = np.hstack([cv2.resize(part, size, interpolation=cv2.INTER_AREA) for part in parts])
        caption = np.full((18, cell.shape[1], 3), 24, np.uint8)
        meta = sample.meta
        text = f"{meta.get('preset', '')}  scene {meta.get('scene', '?')} view {meta.get('view', '?')}  "
        text += f"sun {meta.get('sun_elevation_deg', 0):.0f} deg"
        cv2.putText(caption, text, (4, 13), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (230, 230, 230), 1, cv2.LINE_AA)
        cells.append(cv2.copyMakeBorder(np.vstack([caption, cell]), 3, 3, 3, 3, cv2.BORDER_CONSTANT, value=(24,) * 3))
    if not cells:
        raise ValueError("a contact sheet needs at least one sample")
    columns = min(columns, len(cells))
    while len(cells) % columns:
        cells.append(np.full_like(cells[0], 24))
    return np.vstack([np.hstack(cells[i : i + columns]) for i in range(0, len(cells), columns)])
