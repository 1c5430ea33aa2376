"""The files of a prediction: maps, a picture, a cloud without points between two surfaces, and the record of it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from m3depth.prediction.one_pair import PairPrediction
from m3depth.prediction.options import PredictOptions
from m3depth.prediction.pictures.figure import prediction_figure
from m3depth.prediction.pictures.step_figure import steps_figure
from m3depth.prediction.sources.raw_pairs import FOLDER
from m3depth.rectification.files import remove_pair
from m3depth.stereo.pairs import in_colour
from m3depth.stereo.prediction import Prediction
from marssim.base.camera import StereoRig
from marssim.base.dataset.map_file import MAP_FORMATS, MAP_KINDS, encode_map
from marssim.base.files.atomic import write_atomically
from marssim.base.files.json_file import DatasetError, write_json
from marssim.base.files.npy import encode_npy
from marssim.base.files.png import encode_png
from marssim.base.images.depth_edges import depth_edges
from marssim.base.images.pointcloud import coloured_points, encode_ply
from marssim.base.pose import moved
from marssim.base.results.claim import PARTIAL, ResultFolder

EDGE_SHARE = 0.02  # largest change of disparity within 3 x 3 px, as a share of it, that is no depth edge
RECORD = "prediction.json"  # written last: a folder that has it is whole
CLOUD, FIGURE, DIFFERENCE, STEPS, SKY = "cloud.ply", "figure.png", "left_right.npy", "steps.png", "sky.png"
FILES = (*(f"{kind}.{form}" for kind in MAP_KINDS for form in MAP_FORMATS), SKY, CLOUD, FIGURE, DIFFERENCE, STEPS)
UNFINISHED = '{"unfinished": "predict this pair again"}\n'  # RECORD of one pair while its files are written


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
    keep = trusted_pixels(prediction.disparity, prediction.confidence, min_confidence)
    return coloured_points(in_colour(left), np.where(keep, prediction.depth, np.nan), rig.camera, max_range)


def read_cloud(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return the points (N, 3) [m] and the colours (N, 3) uint8 of a cloud's file; N is 0 where it holds none."""
    import trimesh  # not at the top, since it loads Embree

    cloud: Any = trimesh.load(path)
    points = np.asarray(getattr(cloud, "vertices", ())).reshape(-1, 3)  # without points, it is a scene
    return points, np.asarray(cloud.colors)[:, :3] if len(points) else np.zeros((0, 3), np.uint8)


def trusted_pixels(disparity: np.ndarray, confidence: np.ndarray, min_confidence: float) -> np.ndarray:
    """Return the pixels that become points: sure ones that do not hang between two surfaces, (H, W) bool.

    Args:
        disparity: (H, W) [px].
        confidence: (H, W), 0 to 1.
        min_confidence: Pixels of less confidence are left out.
    """
    with np.errstate(invalid="ignore"):
        sure = confidence >= min_confidence
    return np.asarray(sure & ~depth_edges(disparity, share=EDGE_SHARE))


def single_folder(out: Path) -> ResultFolder:
    """Return the folder for the results of one pair, which replace those of an earlier pair and leave other files.

    Raises:
        DatasetError: A file in it would be replaced or deleted that is of no prediction; the message names it.
    """
    if not (out / RECORD).is_file() and (present := files_in(out)):
        raise DatasetError(
            f"--out {out}: its {present[0]} would be replaced, and no {RECORD} says that it is of an earlier "
            "prediction; choose another"
        )
    partial = PARTIAL, f"{FOLDER}/{PARTIAL}"
    return ResultFolder(out, "prediction", RECORD, mark_text=UNFINISHED, shared=True, partial=partial)


def files_in(out: Path) -> list[str]:
    """Return the names of the files in a folder that a prediction may write or delete, but its record."""
    return [name for name in FILES if (out / name).exists()]


def write_prediction(
    out: Path,
    result: PairPrediction,
    options: PredictOptions,
    record: Mapping[str, Any],
    shown: tuple[float, float],
    cloud_pose: np.ndarray,
    single: bool = False,
    replaces: bool = True,
) -> int:
    """Write the files of one pair that the flags ask for, each in one step, and delete those of an earlier run.

    Args:
        out: The folder; it is made.
        result: The prediction.
        options: The command's flags.
        record: Content of prediction.json, which is written last.
        shown: Nearest and farthest depth [m] of the picture's scale.
        cloud_pose: (4, 4) camera to the frame of the point cloud.
        single: Whether `out` is a single_folder. Its record then stays, as UNFINISHED, and the rows of a pair that was
            raw are drawn, which takes some seconds.
        replaces: Whether the files in it, if any, are those of an earlier run.

    Returns:
        The number of points of the cloud; 0 without one.

    Raises:
        OSError: A file cannot be written; the message names it.
    """
    out.mkdir(parents=True, exist_ok=True)
    if not single:
        (out / RECORD).unlink(missing_ok=True)
    elif replaces:
        write_atomically(out / RECORD, UNFINISHED.encode())
    maps = {kind: getattr(result.prediction, kind) for kind in MAP_KINDS}
    for kind in MAP_KINDS:
        for form in MAP_FORMATS:
            if maps[kind] is not None and kind in options.kinds and form in options.map_format:
                write_atomically(out / f"{kind}.{form}", encode_map(maps[kind], kind, form))
            else:  # files of an earlier run would be taken for this one's
                (out / f"{kind}.{form}").unlink(missing_ok=True)
    count = 0
    for name in (SKY, CLOUD, FIGURE, DIFFERENCE, STEPS):
        (out / name).unlink(missing_ok=True)
    if "sky" in options.write:
        write_atomically(out / SKY, encode_png(np.where(result.prediction.is_sky, np.uint8(255), np.uint8(0))))
    if "cloud" in options.write:
        points, colours = point_cloud(
            result.left, result.prediction, result.rig, options.cloud_confidence, options.max_range
        )
        if options.cloud_frame != "camera":
            points = moved(points, cloud_pose)
        write_atomically(out / CLOUD, encode_ply(points, colours))
        count = len(points)
    if "figure" in options.write:
        prediction_figure(result.left, result.prediction, out / FIGURE, shown)
    if result.difference is not None:
        write_atomically(out / DIFFERENCE, encode_npy(result.difference))
    if result.rectified is not None:
        result.rectified.write(out / FOLDER, single)
    elif replaces and (out / FOLDER).is_dir():
        read = [Path(record["left"]), Path(record["right"]), *options.calib, *options.mask]
        if not any(path.resolve().is_relative_to((out / FOLDER).resolve()) for path in read):
            remove_pair(out / FOLDER)  # of an earlier pair
    if result.steps:
        steps_figure(result.steps, result.rig.fb, result.common, shown, out / STEPS)
    write_json(out / RECORD, dict(record), sort_keys=False)
    return count
