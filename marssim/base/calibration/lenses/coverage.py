"""Which part of an image a lens model accounts for. A distortion that was fitted badly folds over inside the image."""

from __future__ import annotations

import numpy as np

from marssim.base.calibration.lenses.lens import Lens

GRID = 65  # places along a side at which rays are computed
MOST_UNSEEN = 0.05  # share of an image that may lie beyond the fold: corners that no target reached


def unseen_share(lens: Lens, size: tuple[int, int]) -> float:
    """Return the share of an image's pixels that no ray reaches, since the model folds over before them.

    Args:
        lens: The lens.
        size: Width and height of the image [px].
    """
    u, v = np.meshgrid(np.linspace(0, size[0] - 1, GRID), np.linspace(0, size[1] - 1, GRID))
    return float(np.isnan(lens.rays(np.stack([u, v], axis=-1)).direction[..., 0]).mean())


def check_lens(lens: Lens, size: tuple[int, int], name: str) -> None:
    """Raise ValueError if a lens model folds over well inside the image.

    Args:
        lens: The lens.
        size: Width and height of the image [px].
        name: What the message calls the distortion.
    """
    share = unseen_share(lens, size)
    if share > MOST_UNSEEN:
        raise ValueError(
            f"{name} folds over inside the image of {size[0]} x {size[1]} px: {100 * share:.0f} % of its pixels have "
            "no ray"
        )
