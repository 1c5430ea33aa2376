"""The picture of the depth after each refinement step, and of what each step changed."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from m3depth.prediction.pictures.figure import GAP, LINE, PAPER, draw_scale, sized, titled
from m3depth.stereo.prediction import StepMap
from marssim.base.files.atomic import write_atomically
from marssim.base.files.png import encode_png
from marssim.base.images.colours import depth_colours

COLUMNS = 4  # maps in a row
WIDEST = 400  # [px] width of a map in the picture
LARGEST = 1.0  # [px] change of disparity at the ends of the colours


def changes(steps: Sequence[StepMap]) -> list[float | None]:
    """Return by how much each step changed the disparity in the mean [px]; None for the first map.

    Pixels whose disparity is NaN in one of the two maps are left out; without any other, there is None too.
    """
    means: list[float | None] = [None]
    for before, after in pairwise(steps):
        change = np.abs(after.disparity - before.disparity)
        finite = change[np.isfinite(change)]
        means.append(float(finite.mean()) if finite.size else None)
    return means


def steps_record(steps: Sequence[StepMap]) -> list[dict[str, Any]]:
    """Return what prediction.json says of the steps: name, size of the images, and change of disparity [px]."""
    return [
        {"name": step.name, "size": list(step.working_size), "mean_change_px": change}
        for step, change in zip(steps, changes(steps), strict=True)
    ]


def change_colours(change: np.ndarray) -> np.ndarray:
    """Return a change of disparity as colours: white where there is none, blue to nearer, red to farther.

    Args:
        change: (H, W) [px]; NaN where it is unknown.

    Returns:
        (H, W, 3) uint8 RGB; full colours from LARGEST on, black where the change is unknown.
    """
    share = np.nan_to_num(np.clip(change / LARGEST, -1, 1))
    fade = 1 - np.abs(share)
    blue, red = (np.where(side * share > 0, 1.0, fade) for side in (1, -1))
    colours = (255 * np.stack([red, fade, blue], axis=-1)).astype(np.uint8)
    colours[np.isnan(change)] = 0
    return colours


def steps_picture(steps: Sequence[StepMap], fb: float, common: float, shown: tuple[float, float]) -> np.ndarray:
    """Return the picture, (h, w, 3) uint8 RGB: the depth after each step, and below it what the step changed.

    Args:
        steps: The maps in the order of the steps, one or more, of one size.
        fb: Focal length times baseline [px m].
        common: Disparity that all pixels with depth have beside that of the maps [px].
        shown: Nearest and farthest depth [m] of the scale.
    """
    near, far = shown
    panels = []
    for number, (step, mean) in enumerate(zip(steps, changes(steps), strict=True)):
        with np.errstate(divide="ignore"):
            beyond = (step.disparity == 0) | (step.disparity + common < 0)  # a step may overshoot infinity
            depth = np.where(beyond, np.inf, fb / (step.disparity + common))
        height, width = step.working_size
        above = titled(f"{step.name} in {width} x {height} px", sized(depth_colours(depth, near, far), WIDEST))
        if number == 0:
            below = np.full_like(above, PAPER)
        else:
            change = change_colours(step.disparity - steps[number - 1].disparity)
            words = "unknown" if mean is None else f"{mean:.3f} px in the mean"
            below = titled(f"change: {words}; {LARGEST:g} px nearer blue, farther red", sized(change, WIDEST))
        panels.append(np.concatenate([above, below]))
    height, width = panels[0].shape[:2]
    columns = min(COLUMNS, max(2, len(panels)))
    rows = -(-len(panels) // columns)
    page = np.full((rows * (height + GAP) + LINE + 12, columns * (width + GAP) - GAP, 3), PAPER, np.uint8)
    for number, panel in enumerate(panels):
        row, column = divmod(number, columns)
        page[row * (height + GAP) :, column * (width + GAP) :][:height, :width] = panel
    draw_scale(page[rows * (height + GAP) :], width, near, far)
    return page


def steps_figure(steps: Sequence[StepMap], fb: float, common: float, shown: tuple[float, float], path: Path) -> None:
    """Write the picture of the steps as PNG.

    Args:
        steps: See steps_picture.
        fb: Focal length times baseline [px m].
        common: Disparity that all pixels with depth have beside that of the maps [px].
        shown: Nearest and farthest depth [m] of the scale.
        path: The file to write.

    Raises:
        OSError: The file cannot be written; the message names it.
    """
    picture = steps_picture(steps, fb, common, shown)
    write_atomically(path, encode_png(picture[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 1]))
