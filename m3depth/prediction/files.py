"""The files of a prediction: arrays, pictures, and a point cloud without points between two surfaces."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from m3depth.prediction.figure import prediction_figure
from m3depth.stereo.pairs import in_colour
from m3depth.stereo.prediction import Prediction
from marssim.base.camera import StereoRig
from marssim.base.files.atomic import write_atomically
from marssim.base.files.npy import encode_npy
from marssim.base.files.png import encode_png
from marssim.base.images.colours import normal_colours
from marssim.base.images.depth_edges import depth_edges
from marssim.base.images.pointcloud import coloured_points, encode_ply

EDGE_SHARE = 0.02  # largest change of disparity within 3 x 3 px, as a share of it, that is no depth edge


def without_sky_normals(prediction: Prediction) -> Prediction:
    """Return the prediction with normals set to 0, which means none, where depth is not finite."""
    if prediction.normal is None:
        return prediction
    normal = np.where(np.isfinite(prediction.depth)[..., None], prediction.normal, np.float32(0))
    return replace(prediction, normal=normal)


def point_cloud(
    left: np.ndarray, prediction: Prediction, rig: StereoRig, min_confidence: float = 0.5, max_range: float = 30.0
) -> tuple[np.ndarray, np.ndarray]:
    """Return the points that can be trusted, and their colours.

    Pixels of unknown depth and depth edges are left out.

    Args:
        left: (H, W) or (H, W, 3) uint8 left image.
        prediction: Its maps.
        rig: The cameras of the images.
        min_confidence: Pixels of less confidence are left out.
        max_range: Points of larger depth [m] are left out.

    Returns:
        (N, 3) float32 points [m] in the left camera's frame, and (N, 3) uint8 RGB.
    """
    with np.errstate(invalid="ignore"):
        keep = prediction.confidence >= min_confidence
    keep &= ~depth_edges(prediction.disparity, share=EDGE_SHARE)
    return coloured_points(in_colour(left), np.where(keep, prediction.depth, np.nan), rig.camera, max_range)


def write_prediction(
    out: Path, left: np.ndarray, prediction: Prediction, rig: StereoRig, min_confidence: float, max_range: float
) -> int:
    """Write every file that m3depth.predict lists, each in one step.

    Args:
        out: The folder; it is made.
        left: (H, W) or (H, W, 3) uint8 left image.
        prediction: Its maps.
        rig: The cameras of the images.
        min_confidence: Pixels of less confidence are left out of the point cloud.
        max_range: Points of larger depth [m] are left out of the point cloud.

    Returns:
        The number of points of the cloud.

    Raises:
        OSError: A file cannot be written; the message names it.
    """
    out.mkdir(parents=True, exist_ok=True)
    for name in ("depth", "disparity", "normal", "confidence"):
        array = getattr(prediction, name)
        if array is not None:
            write_atomically(out / f"{name}.npy", encode_npy(array))
        else:  # files of an earlier run would be taken for this one's
            for suffix in ("npy", "png"):
                (out / f"{name}.{suffix}").unlink(missing_ok=True)
    _write_png(out / "depth.png", _uint16(prediction.depth * 1000.0))
    _write_png(out / "disparity.png", _uint16(prediction.disparity * 256.0))
    if prediction.normal is not None:
        _write_png(out / "normal.png", np.ascontiguousarray(normal_colours(prediction.normal)[..., ::-1]))
    points, colour = point_cloud(left, prediction, rig, min_confidence, max_range)
    write_atomically(out / "cloud.ply", encode_ply(points, colour))
    prediction_figure(left, prediction, out / "figure.png")
    return len(points)


def _uint16(values: np.ndarray) -> np.ndarray:
    """Return rounded values; 0 where a value is not finite or does not fit."""
    fits = np.isfinite(values) & (values >= 0) & (values < 65535.5)
    return np.round(np.where(fits, values, 0)).astype(np.uint16)


def _write_png(path: Path, image: np.ndarray) -> None:
    write_atomically(path, encode_png(image))
