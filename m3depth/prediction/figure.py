"""The figure of one prediction."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from m3depth.figures.drawing import (
    colour_map,
    depth_scale,
    known_depths,
    label_bar,
    normal_image,
    panel_aspect,
    save,
    show,
)
from m3depth.stereo.pairs import in_colour
from m3depth.stereo.prediction import Prediction
from marssim.base.images.colours import DEPTH_MAP, NORMAL_TITLE

FARTHEST = 300.0  # [m] largest depth at which the colours may end


def prediction_figure(left: np.ndarray, prediction: Prediction, path: Path) -> None:
    """Write a PNG of one prediction: left image, depth, normals, confidence.

    Args:
        left: (H, W) or (H, W, 3) uint8 left image.
        prediction: Its maps.
        path: The file to write.
    """
    figure = Figure(figsize=(11, 1.0 + 10.2 * panel_aspect(left)), layout="constrained", dpi=110)
    (image_axes, depth_axes), (normal_axes, confidence_axes) = figure.subplots(2, 2)
    show(image_axes, in_colour(left))
    image_axes.set_title("left image")
    colours = colour_map(DEPTH_MAP)
    norm = depth_scale(prediction.depth[np.isfinite(prediction.depth)], farthest=FARTHEST)
    shown = show(depth_axes, known_depths(prediction.depth), cmap=colours, norm=norm)
    bar = figure.colorbar(shown, ax=depth_axes, fraction=0.046, pad=0.02, extend="both")
    label_bar(bar, norm, "depth [m]")
    depth_axes.set_title("depth (grey: sky or unknown)")
    if prediction.normal is not None:
        show(normal_axes, normal_image(prediction.normal))
        normal_axes.set_title(NORMAL_TITLE)
    else:
        normal_axes.set_axis_off()
    shown = show(confidence_axes, prediction.confidence, cmap=colour_map("cividis"), norm=Normalize(0, 1))
    figure.colorbar(shown, ax=confidence_axes, fraction=0.046, pad=0.02)
    confidence_axes.set_title("confidence")
    save(figure, path)
