"""The depth of `lite` without its normals, for docs/scoring/score_manifest.py.

    python docs/scoring/score_manifest.py --data data/manifest --out out/depth-alone --sizes 512 --no-map \\
        --baselines none --sets clean degraded sun10 --estimator "lite, depth alone=depth_alone:DepthAlone"

m3depth.evaluate fits planes to the depth of a method without normals. So this row of the tables has the normals that
the depth of `lite` gives without any network, beside those of `fusion` and `geo-net`, which are given the same depth.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from m3depth.estimator import load_estimator
from m3depth.stereo.prediction import Prediction
from marssim.base.camera import StereoRig

WEIGHTS = Path(__file__).parents[1] / "results/methods/weights/lite.safetensors"


class DepthAlone:
    """The `lite` of docs/results/methods.md without its normals."""

    def __init__(self) -> None:
        self._network = load_estimator(f"m3depth:{WEIGHTS}", runtime="openvino")

    def infer(self, left: np.ndarray, right: np.ndarray, rig: StereoRig) -> Prediction:
        """Return the prediction for a rectified pair, without normals; see M3Depth.infer."""
        return replace(self._network.infer(left, right, rig), normal=None)
