"""Panels that several figures of pairs have: predicted normals, and the error of disparity."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize

from m3depth.evaluation.metrics import has_depth
from m3depth.figures.drawing import colour_map, normal_image, note, show


def predicted_normal_image(normal: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Return normal_image of predicted normals, grey where there is no depth: there they mean nothing."""
    return normal_image(np.where(has_depth(depth)[..., None], normal, np.float32(0)))


def show_disparity_error(
    ax: Axes, disparity: np.ndarray, truth: np.ndarray, scored: np.ndarray, scale: Normalize
) -> Any:
    """Show the error of disparity, with its mean over the pixels that are scored.

    Args:
        ax: Axes to draw in.
        disparity: (H, W) of the prediction [px]; unknown counts as 0 px.
        truth: (H, W) of the truth [px].
        scored: (H, W) bool.
        scale: Range of the colours of errors [px].

    Returns:
        imshow's result.
    """
    error = np.where(scored, np.abs(np.where(np.isfinite(disparity), disparity, 0) - truth), np.nan)
    note(ax, f"{np.nanmean(error):.2f} px" if np.isfinite(error).any() else "nothing known")
    return show(ax, error, cmap=colour_map("inferno"), norm=scale)
