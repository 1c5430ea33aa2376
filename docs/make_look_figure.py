"""Makes the figure of docs/results/look.md, real ground beside rendered ground: images/look.jpg.

    python docs/make_look_figure.py --images real

The folder holds the real images, as for blind_comparison.py, whose crops these are.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import tyro
from blind_comparison import FRAMES, Frame, real_crops, rendered_crop

FIGURE = Path(__file__).parent / "images" / "look.jpg"
TILE, GAP = 270, 4  # [px] side of a crop in the figure, and width between crops
QUALITY = 80  # of the JPEG


@dataclass(frozen=True)
class Options:
    """Makes the figure of docs/results/look.md."""

    images: Path
    """Folder with the real images."""
    seed: int = 11
    """Seed of the crops."""


def main(options: Annotated[Options, tyro.conf.arg(name="")]) -> None:
    rows = [row(frame, options, n) for n, frame in enumerate(FRAMES)]
    cv2.imwrite(str(FIGURE), np.vstack(rows), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])


def row(frame: Frame, options: Options, n: int) -> np.ndarray:
    """Return two crops of a real image, and two that show its place, rendered, as it would."""
    rng = np.random.default_rng((options.seed, n))
    crops = [crop for crop, _ in real_crops(options.images, [frame] * 2, rng)]
    crops += [rendered_crop(frame, int(rng.integers(2**31)))[0] for _ in range(2)]
    tiles = [cv2.resize(crop, (TILE, TILE), interpolation=cv2.INTER_CUBIC) for crop in crops]
    return np.hstack([cv2.copyMakeBorder(tile, GAP, 0, GAP, 0, cv2.BORDER_CONSTANT, value=255) for tile in tiles])


if __name__ == "__main__":
    main(tyro.cli(Options))
