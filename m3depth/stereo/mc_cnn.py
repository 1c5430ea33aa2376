"""MC-CNN with semi-global matching: costs from a network that CNES trained, of the package mccnn (extra `rivals`).

Zbontar and LeCun: "Stereo Matching by Training a Convolutional Neural Network to Compare Image Patches", JMLR 2016. The
fast network describes 11 x 11 px around each pixel by a unit vector; the cost of a match is less their product. The
weights, trained on Middlebury and quantised, come with the package.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np

from m3depth.stereo.classical import Matcher, check_search, grey_pair, search_range, without_speckles
from m3depth.stereo.window_costs import HIGHEST, semi_global, winners
from marssim.base.camera import StereoRig

MARGIN = 5  # pixels that the network's window reaches to either side
PENALTIES = (800, 4000)  # of semi-global matching: the best of four pairs of penalties on three training pairs
NETWORK = "mc_cnn_fast_int8_excl_01.onnx"


def mccnn_weights() -> Path | None:
    """Return the file of the network's weights; None where the package mccnn is not installed."""
    return Path(str(files("mc_cnn.weights") / NETWORK)) if find_spec("mc_cnn") else None


@dataclass(frozen=True)
class McCnn(Matcher):
    """MC-CNN's fast network with semi-global matching along eight paths.

    Raises:
        ImportError: The package is not installed; the message names the extra.
        ValueError: A setting that cannot work; the message names it.
    """

    disparities: int | None = None
    """Width of the search [px], a multiple of 16; None reaches to 0.84 m with the given rig."""
    speckle: int = 400
    """Islands of disparity with fewer pixels count as unmatched."""

    def __post_init__(self) -> None:
        check_search(self.disparities, 2 * MARGIN + 1)
        if mccnn_weights() is None:
            raise ImportError('mccnn is not installed; pip install "mars-m3depth[rivals]"')

    def match(self, left: np.ndarray, right: np.ndarray, rig: StereoRig) -> np.ndarray:
        """Return the disparity of matches, as Matcher.match does."""
        from mc_cnn.run import run_mc_cnn_fast

        reach = min(self.disparities or search_range(rig), rig.camera.width)
        padded = [
            cv2.copyMakeBorder(image, MARGIN, MARGIN, MARGIN, MARGIN, cv2.BORDER_REPLICATE).astype(np.float32)
            for image in grey_pair(left, right, rig)
        ]
        # (H, W, D), the largest disparity first; -1 is the best match, NaN lies outside the right image
        costs = run_mc_cnn_fast(*padded, 1 - reach, 0, str(mccnn_weights()))
        scaled = np.nan_to_num((costs[..., ::-1] + 1) * np.float32(HIGHEST / 2) + np.float32(0.5), nan=HIGHEST)
        volume = np.ascontiguousarray(scaled.clip(0, HIGHEST).astype(np.uint16).transpose(2, 0, 1))
        return without_speckles(winners(semi_global(volume, *PENALTIES)), self.speckle)
