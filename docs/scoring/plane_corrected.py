"""The depth of `lite`, corrected by its normals, for docs/scoring/score_manifest.py.

    python docs/scoring/score_manifest.py --data data/manifest --out out/planes --sizes 512 --no-map --baselines none \\
        --sets clean degraded sun10 --weights docs/results/methods/weights/lite.safetensors \\
        --estimator "lite, corrected by its normals=plane_corrected:PlaneCorrected"

GeoNet corrects depth by normals (Qi et al., CVPR 2018, Eq. 7 and 8): each pixel of a window says where its own plane
meets the ray of the middle one, and their weighted mean is the corrected depth. Here the normals are those of `lite`.
GeoNet weighs a pixel by how alike the normals are, which mixes two surfaces behind each other that are parallel. Its
last network, which is trained, makes up for that. Here nothing is trained: a pixel whose plane passes the middle point
at a distance counts less.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from m3depth.estimator import load_estimator
from m3depth.network.geometry import MIN_DISPARITY, pixel_rays
from m3depth.network.inference import camera_row
from m3depth.rivals.geo_net import ALIKE, GRAZING, windows
from m3depth.stereo.prediction import Prediction
from marssim.base.camera import StereoRig

WEIGHTS = Path(__file__).parents[1] / "results/methods/weights/lite.safetensors"
# Chosen on pairs that are not of the manifest: python -m marssim.generate --scene mixed --pairs 60 --seed 9401
SIDE = 5  # pixels along the side of a window
SPACING = 2  # distance between them [px]
NEAR = 0.2  # difference in disparity at which the weight of a plane falls to 1/e [px]


def corrected_disparity(disparity: np.ndarray, normal: np.ndarray, rig: StereoRig) -> np.ndarray:
    """Return the disparity that the planes of the pixels around each pixel give it.

    Args:
        disparity: (H, W) float32 [px]; below MIN_DISPARITY or NaN, a pixel stays as it is and corrects no other.
        normal: (H, W, 3) float32, unit length, facing the camera, NaN where it is unknown.
        rig: The cameras.

    Returns:
        (H, W) float32 [px].
    """
    height, width = disparity.shape
    rays = pixel_rays(camera_row(rig, torch.device("cpu")), height, width)[0]
    normals = torch.from_numpy(np.moveaxis(normal, 2, 0).copy())
    given = torch.from_numpy(disparity)
    valid = (given >= MIN_DISPARITY) & torch.isfinite(normals).all(0)
    measured, normals = torch.where(valid, given, 1.0), torch.where(valid, normals, 0.0)
    facing = -(normals * rays).sum(0)
    moments, weights = torch.zeros_like(measured), torch.zeros_like(measured)
    around = torch.cat([measured[None], facing[None], normals, valid.to(normals)[None]])[None]
    for _, _, moved in windows(around, SIDE, SPACING):
        (other, other_facing, *_, other_valid), other_normal = moved[0], moved[0, 2:5]
        alike = (other_normal * normals).sum(0)
        meets = -(other_normal * rays).sum(0)
        # The plane of the other pixel has the disparity d (n . r) / (n . its ray) on the ray r of this one.
        proposed = other * meets / other_facing.clamp(min=GRAZING)
        weight = torch.exp(-(((proposed - measured) / NEAR) ** 2)) * alike
        weight *= (other_valid > 0) & (alike > ALIKE) & (meets > GRAZING)
        moments += weight * proposed
        weights += weight
    return torch.where(valid & (weights > 0), moments / weights.clamp(min=1e-6), given).numpy()


class PlaneCorrected:
    """The `lite` of docs/results/methods.md, whose normals correct its depth.

    It runs in what `--runtime auto` chooses: give score_manifest.py no other.
    """

    files = WEIGHTS

    def __init__(self) -> None:
        self._network = load_estimator(f"m3depth:{WEIGHTS}", runtime="auto")

    def infer(self, left: np.ndarray, right: np.ndarray, rig: StereoRig) -> Prediction:
        """Return the prediction for a rectified pair, with the corrected depth; see M3Depth.infer."""
        given = self._network.infer(left, right, rig)
        if given.normal is None:
            raise ValueError(f"{WEIGHTS}: gives no normals")
        disparity = corrected_disparity(given.disparity, given.normal, rig)
        with np.errstate(invalid="ignore"):  # of the sky, 0 over 0
            depth = np.where(disparity > 0, given.depth * given.disparity / disparity, given.depth)
        return replace(given, depth=depth.astype(np.float32), disparity=disparity)
